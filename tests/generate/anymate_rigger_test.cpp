#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/anymate/heads.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/anymate_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/nn/state_dict.h"
#include "tests/generate/anymate_bar.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::generate {

namespace {

constexpr const char* kJoints = "transformer_latent";
constexpr const char* kConnectivity = "attendjoints_con_combine";
constexpr const char* kSkin = "attendjoints_combine";

/// Small models for the decoders named; "" for none.
AnymateModels small_models(const std::string& joints, const std::string& connectivity, const std::string& skin) {
  AnymateModels models;
  if (!joints.empty()) models.joints = small_trained("bert", joints);
  if (!connectivity.empty()) models.connectivity = small_trained("bert", connectivity);
  if (!skin.empty()) models.skin = small_trained("bert", skin);
  return models;
}

const rigging::JointProposer& given() {
  static const rigging::JointProposer proposer(rigging::JointSource::kGiven, {});
  return proposer;
}

Asset rigged(AnymateRigger& rigger, const io::RiggedShape& shape) {
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.skeleton = rigger.propose(shape, given()).skeleton;
  asset.skin = rigger.bind(shape, asset.skeleton);
  return asset;
}

double apart(const Skeleton& a, const Skeleton& b, double scale = 1.0) {
  if (a.parents != b.parents) return 1e9;
  double most = 0.0;
  for (std::size_t j = 0; j < a.size(); ++j)
    most = std::max(most, (scale * a.positions()[j] - b.positions()[j]).norm());
  return most;
}

class EveryJointDecoder : public testing::TestWithParam<const char*> {};

TEST_P(EveryJointDecoder, GivesASoundRigThatTheSeedDecides) {
  AnymateRiggerOptions options;
  options.eps = 1e-3;  // random models say much the same of all joints
  AnymateRigger rigger(small_models(GetParam(), kConnectivity, kSkin), options);
  const Asset first = rigged(rigger, bar());
  EXPECT_EQ(validate(first), std::vector<std::string>{});
  EXPECT_GE(first.skeleton.size(), 1u);
  EXPECT_EQ(first.skin.rows(), 8u);
  EXPECT_LE(first.skin.largest_row(), 4u);

  io::RiggedShape other = bar();
  for (std::size_t v = 0; v < 4; ++v) other.mesh.vertices[v].z() -= 1.0F;
  rigged(rigger, other);
  const Asset again = rigged(rigger, bar());
  EXPECT_EQ(apart(first.skeleton, again.skeleton), 0.0) << "what came before must not matter";
  EXPECT_EQ(to_dense(first.skin, first.skeleton.size()), to_dense(again.skin, again.skeleton.size()));

  if (anymate::task_of(anymate::ModelOptions::released("bert", GetParam()).decoder) == anymate::Task::kJointVolume) {
    return;  // the cells of a random field hardly depend on the points
  }
  options.seed = 1;
  AnymateRigger reseeded(small_models(GetParam(), kConnectivity, kSkin), options);
  EXPECT_GT(apart(first.skeleton, rigged(reseeded, bar()).skeleton), 0.0) << "other points, other noise";
}

TEST_P(EveryJointDecoder, AnswersInTheFrameOfTheMesh) {
  AnymateRigger rigger(small_models(GetParam(), kConnectivity, ""), {});
  // A power of two leaves every bit of what the models see as it is.
  const Skeleton small = rigger.propose(bar(), given()).skeleton, large = rigger.propose(bar(8.0), given()).skeleton;
  EXPECT_LT(apart(small, large, 8.0), 1e-9);
}

INSTANTIATE_TEST_SUITE_P(AnymateRigger, EveryJointDecoder,
                         testing::Values(kJoints, "Pointe_Diffusion", "Cross_Attention_Diffusion",
                                         "implicit_transformer", "triplane"));

TEST(AnymateRigger, WithoutConnectivityTheTreeIsTheShortest) {
  AnymateRiggerOptions options;
  options.eps = 1e-5;
  AnymateRigger rigger(small_models(kJoints, "", ""), options);
  const Skeleton skeleton = rigger.propose(bar(), given()).skeleton;
  const std::vector<int> shortest = shortest_tree(skeleton.positions());
  EXPECT_GT(skeleton.size(), 1u);
  EXPECT_EQ(skeleton.parents, shortest);
}

TEST(AnymateRigger, EpsMergesJoints) {
  AnymateRiggerOptions options;
  options.eps = 1e3;
  AnymateRigger rigger(small_models(kJoints, kConnectivity, kSkin), options);
  const Asset asset = rigged(rigger, bar());
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  EXPECT_EQ(asset.skeleton.size(), 1u);
  EXPECT_EQ(asset.skin.largest_row(), 1u);
}

TEST(AnymateRigger, ADenoiserStartsFromAsManyJointsAsAreWanted) {
  const auto joints_of = [](const std::string& decoder, std::size_t wanted) {
    AnymateRiggerOptions options;
    options.eps = 1e-6;  // next to nothing merges
    options.joints = wanted;
    AnymateRigger rigger(small_models(decoder, "", ""), options);
    return rigger.propose(bar(), given()).skeleton.size();
  };
  for (const char* decoder : {"Pointe_Diffusion", "Cross_Attention_Diffusion"}) {
    EXPECT_EQ(joints_of(decoder, 5), 5u) << decoder;
    EXPECT_EQ(joints_of(decoder, 17), 17u) << decoder;
  }
  EXPECT_EQ(joints_of(kJoints, 5), joints_of(kJoints, 0)) << "a regression has as many as it has";
}

TEST(AnymateRigger, GivenJointsKeepTheirPlacesAndNames) {
  const std::map<std::string, double> wanted = {{"hip", 0.5}, {"knee", 2.0}, {"foot", 3.5}};
  for (const char* decoder : {kConnectivity, "attendjoints_con_token"}) {
    AnymateRigger rigger(small_models("", decoder, ""), {});
    const Skeleton skeleton = rigger.propose(bar(), given()).skeleton;
    ASSERT_EQ(skeleton.size(), 3u) << decoder;
    EXPECT_EQ(skeleton.parents[0], -1);
    for (std::size_t j = 0; j < 3; ++j)
      EXPECT_LT((skeleton.positions()[j] - Eigen::Vector3d(wanted.at(skeleton.names[j]), 0.25, 0.25)).norm(), 1e-9);
  }
  AnymateRigger only_skin(small_models("", "", kSkin), {});
  EXPECT_EQ(only_skin.propose(bar(), given()).skeleton.parents, (std::vector<int>{-1, 0, 1}));
  io::RiggedShape bare = bar();
  bare.joints = {};
  EXPECT_THROW(only_skin.propose(bare, given()), InputError);
  bare.mesh.faces.clear();
  EXPECT_THROW(only_skin.propose(bare, given()), InputError);
}

TEST(RigBones, RunFromParentsToChildren) {
  const torch::Tensor joints = torch::arange(9, torch::kFloat32).view({3, 3});
  const RigBones found = bones_between(joints, {1, -1, 0});
  EXPECT_EQ(found.heads, (std::vector<int>{1, 0}));
  const torch::Tensor expected =
      torch::tensor({{3.0F, 4.0F, 5.0F, 0.0F, 1.0F, 2.0F}, {0.0F, 1.0F, 2.0F, 6.0F, 7.0F, 8.0F}});
  EXPECT_TRUE(torch::equal(found.bones, expected));
}

TEST(RigBones, EveryJointOfAnyOtherRigHasItsOwn) {
  const torch::Tensor joints =
      torch::tensor({{0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {0.0F, 2.0F, 0.0F}, {1.0F, 4.0F, 0.0F}});
  const RigBones found = bones_of_rig(joints, {-1, 0, 0, 2});
  EXPECT_EQ(found.heads, (std::vector<int>{0, 1, 2, 3}));
  EXPECT_TRUE(torch::equal(found.bones.slice(1, 0, 3), joints));
  // Two children, a tip, one child, a tip.
  const torch::Tensor tails =
      torch::tensor({{0.5F, 1.0F, 0.0F}, {1.5F, 0.0F, 0.0F}, {1.0F, 4.0F, 0.0F}, {1.5F, 5.0F, 0.0F}});
  EXPECT_TRUE(torch::equal(found.bones.slice(1, 3, 6), tails));
}

/// The shares of the bones at all vertices, as the module gives them without this pipeline.
torch::Tensor direct_shares(TrainedAnymateModel& trained, const torch::Tensor& cloud, const torch::Tensor& points,
                            const torch::Tensor& bones) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor latents = trained.model->encode(cloud);
  const anymate::SkinningInput input{latents, points, bones.unsqueeze(0), {}};
  return torch::softmax(trained.model->decoder<anymate::SkinningImpl>().forward(input)[0], -1);
}

TEST(AnymateSkin, OfEveryBoneGoesToItsHead) {
  TrainedAnymateModel trained = small_trained("bert", kSkin);
  torch::manual_seed(5);
  const torch::Tensor cloud = anymate::small_cloud(1, 64), vertices = anymate::small_cloud(1, 9)[0];
  const RigBones bones = bones_between(torch::rand({4, 3}) - 0.5, {-1, 0, 1, 1});
  const SkinWeights skin = anymate_skin(trained, cloud, vertices, bones);
  const torch::Tensor shares = direct_shares(trained, cloud, vertices.unsqueeze(0), bones.bones);
  const std::vector<float> dense = to_dense(skin, 4);
  for (std::size_t v = 0; v < 9; ++v) {
    const torch::Tensor row = shares[static_cast<std::int64_t>(v)];
    EXPECT_NEAR(dense[4 * v], row[0].item<float>(), 1e-3) << v;
    EXPECT_NEAR(dense[4 * v + 1], (row[1] + row[2]).item<float>(), 1e-3) << v;
    EXPECT_EQ(dense[4 * v + 2] + dense[4 * v + 3], 0.0F) << "no bone begins at a tip";
  }
}

TEST(AnymateSkin, ConcatenationGivesVerticesTheNearestPointsShares) {
  TrainedAnymateModel trained = small_trained("bert", "attendjoints_multi");  // runs of 8 points
  torch::manual_seed(5);
  const torch::Tensor cloud = anymate::small_cloud(1, 69);
  const RigBones bones = bones_between(torch::rand({3, 3}) - 0.5, {-1, 0, 1});
  const std::vector<float> dense = to_dense(anymate_skin(trained, cloud, cloud[0].slice(0, 10, 13), bones), 3);
  const torch::Tensor shares = direct_shares(trained, cloud, cloud.slice(1, 0, 64), bones.bones);
  for (std::size_t v = 0; v < 3; ++v)
    EXPECT_NEAR(dense[3 * v], shares[static_cast<std::int64_t>(10 + v)][0].item<float>(), 1e-3) << v;
}

TEST(AnymateSkin, WeightsThatAreNotFiniteAreAnError) {
  TrainedAnymateModel trained = small_trained("bert", kSkin);
  {
    const torch::NoGradGuard no_grad;
    for (torch::Tensor& parameter : trained.model->parameters()) parameter.fill_(std::nanf(""));
  }
  AnymateModels models;
  models.skin = trained;
  AnymateRigger rigger(std::move(models), {});
  const Skeleton chain = rigger.propose(bar(), given()).skeleton;
  EXPECT_THROW(rigger.bind(bar(), chain), InputError);
}

TEST(AnymateRigger, ModelsMustFitTheirPlacesAndThePoints) {
  const auto refused = [](const AnymateModels& models, const AnymateRiggerOptions& options) {
    try {
      AnymateRigger rigger(models, options);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(refused(small_models(kJoints, kConnectivity, kSkin), {}), "");
  const std::string wrong = refused(small_models(kJoints, kSkin, ""), {});
  EXPECT_NE(wrong.find("bert-attendjoints_combine"), std::string::npos) << wrong;
  EXPECT_NE(wrong.find("is for skinning, not for connectivity"), std::string::npos) << wrong;
  EXPECT_NE(refused(small_models(kConnectivity, "", ""), {}).find("not for joints"), std::string::npos);
  EXPECT_NE(refused(small_models("", "", "triplane"), {}).find("not for skinning"), std::string::npos);
  AnymateRiggerOptions few;
  few.points = 5;  // Point-BERT has six groups
  EXPECT_NE(refused(small_models(kJoints, "", ""), few).find("at least 6 points"), std::string::npos);
}

TEST(AnymateRigger, WorksAsStepsOfTheOtherRigger) {
  const test::TemporaryFolder folder;
  const test::RigFile file;
  test::write_glb(folder / "mesh.glb", file);
  rigging::RigRequest request;
  request.meshes = folder / "mesh.glb";
  request.out = folder / "rigged.glb";
  request.learned = LearnedRigger::steps(
      std::make_shared<AnymateRigger>(small_models(kJoints, kConnectivity, kSkin), AnymateRiggerOptions()));
  EXPECT_EQ(rigging::rig_meshes(request).meshes.at(0).failure, "");
  const Asset asset = io::read_gltf(request.out).asset;
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  EXPECT_EQ(asset.mesh.vertices.size(), static_cast<std::size_t>(file.vertex_count()));

  request.learned =
      LearnedRigger::steps(std::make_shared<AnymateRigger>(small_models(kJoints, "", ""), AnymateRiggerOptions()));
  EXPECT_FALSE(request.learned.bind) << "geodesic voxels do that";
  EXPECT_EQ(rigging::rig_meshes(request).meshes.at(0).failure, "");
  EXPECT_FALSE(
      LearnedRigger::steps(std::make_shared<AnymateRigger>(small_models("", "", kSkin), AnymateRiggerOptions()))
          .propose);
}

}  // namespace

namespace {

namespace fs = std::filesystem;
using anymate::AnymateModel;
using anymate::ModelOptions;

constexpr const char kArgs[] = R"({"encoder": "bert", "decoder": "transformer_latent", "width": 24, "heads": 2,
  "num_joints": 10, "bert": {"trans_dim": 12, "num_heads": 2, "depth": 1, "num_group": 6, "group_size": 5,
  "encoder_dims": 16, "projection_1": 16, "projection_2": 16}})";

/// A plain value, as pickle writes it.
void add_value(test::PickleBuilder& pickle, const Json& value) {
  if (value.is_object()) {
    pickle.op("}").mark();
    for (const auto& [key, item] : value.items()) add_value(pickle.text(key), item);
    pickle.op("u");
  } else if (value.is_string()) {
    pickle.text(value.get<std::string>());
  } else {
    pickle.integer(value.get<std::int32_t>());
  }
}

/// A checkpoint as the released code saves one: epoch, state_dict and, unless null, model_config.
void write_checkpoint(const fs::path& path, const io::NamedArrays& state, const Json& config) {
  test::PickleBuilder pickle;
  std::vector<io::ZipContent> storages;
  const auto add_sizes = [&](const std::vector<std::int64_t>& sizes) {
    pickle.mark();
    for (const std::int64_t size : sizes) pickle.integer(static_cast<std::int32_t>(size));
    pickle.tuple();
  };
  pickle.op("}").mark().text("epoch").integer(7).text("state_dict").op("}").mark();
  for (const auto& [key, array] : state) {
    std::vector<std::int64_t> strides(array.shape.size(), 1);
    for (std::size_t d = strides.size(); d-- > 1;) strides[d - 1] = strides[d] * array.shape[d];
    const std::string storage = std::to_string(storages.size());
    const bool is_float = array.dtype == io::Dtype::kF32;
    ASSERT_TRUE(is_float || array.dtype == io::Dtype::kI64) << key;
    pickle.text(key).global("torch._utils", "_rebuild_tensor_v2").mark().mark().text("storage");
    pickle.global("torch", is_float ? "FloatStorage" : "LongStorage").text(storage).text("cpu");
    pickle.integer(static_cast<std::int32_t>(array.count())).tuple().op("Q").integer(0);
    add_sizes(array.shape);
    add_sizes(strides);
    pickle.boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
    storages.push_back({"x/data/" + storage, std::string(array.bytes.begin(), array.bytes.end())});
  }
  pickle.op("u");
  if (!config.is_null()) add_value(pickle.text("model_config"), config);
  std::vector<io::ZipContent> members = {{"x/data.pkl", pickle.op("u").stop()}};
  members.insert(members.end(), storages.begin(), storages.end());
  io::write_zip(path, members);
}

class AnymateCheckpoints : public testing::Test {
 protected:
  AnymateCheckpoints() {
    args_ = parse_json(kArgs, "test");
    torch::manual_seed(3);
    state_ = nn::state_dict(*AnymateModel(ModelOptions::from_json(args_)));
    averages_ = nn::state_dict(*AnymateModel(ModelOptions::from_json(args_)));
  }
  void write_run(const std::string& class_name = "AnymateModel") {
    const Json config = {{"models", {{"rigger", {{"name", class_name}, {"args", args_}}}}},
                         {"dataset", {{"name", "Anymate"}, {"args", {{"points", 64}}}}},
                         {"trainer", {{"name", "AnymateTrainer"}, {"args", {{"num_train_step", 20}}}}}};
    write_file_atomically(folder_ / "run/config.json", config.dump());
    io::write_safetensors(folder_ / "run/ckpts/rigger_step0000002.safetensors", state_);
    io::write_safetensors(folder_ / "run/ckpts/rigger_ema0.99_step0000002.safetensors", averages_);
  }
  static TrainedAnymateModel load(const fs::path& path) { return load_anymate_model(path, torch::kCPU); }
  static std::string refusal(const fs::path& path) {
    try {
      load(path);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  static void expect_weights(const TrainedAnymateModel& trained, const io::NamedArrays& expected) {
    const io::NamedArrays found = nn::state_dict(*trained.model);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_EQ(found[i].second.bytes, expected[i].second.bytes);
  }

  test::TemporaryFolder folder_;
  Json args_;
  io::NamedArrays state_, averages_;
};

TEST_F(AnymateCheckpoints, OfARunWithItsAverages) {
  write_run();
  const TrainedAnymateModel trained = load(folder_ / "run");
  expect_weights(trained, averages_);
  EXPECT_FALSE(trained.model->is_training());
  for (const torch::Tensor& parameter : trained.model->parameters()) EXPECT_FALSE(parameter.requires_grad());
  EXPECT_EQ(trained.points, 64);
  EXPECT_EQ(trained.train_steps, 20);
  EXPECT_EQ(trained.denoised_joints, 128);
  EXPECT_EQ(describe_weights(folder_ / "run")["rigger"]["complete"], true);
}

TEST_F(AnymateCheckpoints, OfOneFileOfARun) {
  write_run();
  const TrainedAnymateModel trained = load(folder_ / "run/ckpts/rigger_step0000002.safetensors");
  expect_weights(trained, state_);
  EXPECT_EQ(trained.points, 64);
}

TEST_F(AnymateCheckpoints, AsReleasedWithTheirConfig) {
  Json config = args_;
  config["num_train_step"] = 50;
  write_checkpoint(folder_ / "any.pth.tar", state_, config);
  const TrainedAnymateModel trained = load(folder_ / "any.pth.tar");
  expect_weights(trained, state_);
  EXPECT_EQ(trained.train_steps, 50);
  EXPECT_EQ(trained.points, 8192);
}

TEST_F(AnymateCheckpoints, WithoutAConfigTheNameSaysWhatTheyAre) {
  write_checkpoint(folder_ / "any.pth.tar", state_, nullptr);
  EXPECT_NE(refusal(folder_ / "any.pth.tar").find("<encoder>-<decoder>"), std::string::npos);
  write_checkpoint(folder_ / "bert-transformer_latent-small.pth.tar", state_, nullptr);
  const std::string sizes = refusal(folder_ / "bert-transformer_latent-small.pth.tar");
  EXPECT_NE(sizes.find("bert-transformer_latent-small.pth.tar"), std::string::npos) << sizes;
  io::write_safetensors(folder_ / "any.safetensors", state_);
  EXPECT_NE(refusal(folder_ / "any.safetensors").find("any.safetensors"), std::string::npos);
}

TEST_F(AnymateCheckpoints, ThatDoNotFitAreNamed) {
  EXPECT_NE(refusal(folder_ / "absent").find("absent"), std::string::npos);
  write_file_atomically(folder_ / "model.txt", "text");
  EXPECT_NE(refusal(folder_ / "model.txt").find("not supported"), std::string::npos);
  write_run("SomethingElse");
  EXPECT_NE(refusal(folder_ / "run").find("AnymateModel"), std::string::npos);
  const std::string lost = averages_.back().first;
  averages_.pop_back();
  write_run();
  EXPECT_NE(refusal(folder_ / "run").find(lost), std::string::npos) << refusal(folder_ / "run");
  EXPECT_NE(refusal(folder_ / "run").find("rigger_ema0.99_step0000002.safetensors"), std::string::npos);
  args_["heads"] = 5;  // do not divide the width
  write_run();
  EXPECT_NE(refusal(folder_ / "run").find("config.json"), std::string::npos) << refusal(folder_ / "run");
}

TEST_F(AnymateCheckpoints, InTheWrongPlaceAreRefused) {
  write_run();
  EXPECT_NO_THROW(load_anymate_models({folder_ / "run", "", ""}, torch::kCPU));
  EXPECT_THROW(load_anymate_models({"", folder_ / "run", ""}, torch::kCPU), InputError);
  EXPECT_THROW(load_anymate_models({"", "", folder_ / "run"}, torch::kCPU), InputError);
  const AnymateModels none = load_anymate_models({}, torch::kCPU);
  EXPECT_FALSE(none.joints || none.connectivity || none.skin);
}

}  // namespace

}  // namespace anigen::generate
