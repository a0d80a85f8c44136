#include "anigen/pipeline/anymate_rigger.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/geometry/spanning_trees.h"
#include "anigen/io/gltf.h"
#include "anigen/models/anymate/skinning.h"
#include "anigen/pipeline/anymate_skin.h"
#include "tests/pipeline/anymate_bar.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::pipeline {
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

const rig::JointProposer& given() {
  static const rig::JointProposer proposer(rig::JointSource::kGiven, {});
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
  for (std::size_t j = 0; j < a.size(); ++j) {
    most = std::max(most, (scale * a.positions()[j] - b.positions()[j]).norm());
  }
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

  if (models::anymate::task_of(models::anymate::decoder_kind(GetParam())) == models::anymate::Task::kJointVolume) {
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
  const std::vector<int> shortest = geometry::shortest_tree(skeleton.positions());
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

TEST(AnymateRigger, GivenJointsKeepTheirPlacesAndNames) {
  const std::map<std::string, double> wanted = {{"hip", 0.5}, {"knee", 2.0}, {"foot", 3.5}};
  for (const char* decoder : {kConnectivity, "attendjoints_con_token"}) {
    AnymateRigger rigger(small_models("", decoder, ""), {});
    const Skeleton skeleton = rigger.propose(bar(), given()).skeleton;
    ASSERT_EQ(skeleton.size(), 3u) << decoder;
    EXPECT_EQ(skeleton.parents[0], -1);
    for (std::size_t j = 0; j < 3; ++j) {
      EXPECT_LT((skeleton.positions()[j] - Eigen::Vector3d(wanted.at(skeleton.names[j]), 0.25, 0.25)).norm(), 1e-9);
    }
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
  const models::anymate::SkinningInput input{latents, points, bones.unsqueeze(0), {}};
  return torch::softmax(trained.model->decoder<models::anymate::SkinningImpl>().forward(input)[0], -1);
}

TEST(AnymateSkin, OfEveryBoneGoesToItsHead) {
  TrainedAnymateModel trained = small_trained("bert", kSkin);
  torch::manual_seed(5);
  const torch::Tensor cloud = models::anymate::small_cloud(1, 64), vertices = models::anymate::small_cloud(1, 9)[0];
  const RigBones bones = bones_between(torch::rand({4, 3}) - 0.5, {-1, 0, 1, 1});
  const SkinWeights skin = anymate_skin(trained, cloud, vertices, bones, 0);
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
  const torch::Tensor cloud = models::anymate::small_cloud(1, 69);
  const RigBones bones = bones_between(torch::rand({3, 3}) - 0.5, {-1, 0, 1});
  const std::vector<float> dense = to_dense(anymate_skin(trained, cloud, cloud[0].slice(0, 10, 13), bones, 0), 3);
  const torch::Tensor shares = direct_shares(trained, cloud, cloud.slice(1, 0, 64), bones.bones);
  for (std::size_t v = 0; v < 3; ++v) {
    EXPECT_NEAR(dense[3 * v], shares[static_cast<std::int64_t>(10 + v)][0].item<float>(), 1e-3) << v;
  }
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
  rig::RigRequest request;
  request.meshes = folder / "mesh.glb";
  request.out = folder / "rigged.glb";
  request.learned = anymate_steps(small_models(kJoints, kConnectivity, kSkin), {});
  EXPECT_EQ(rig::rig_meshes(request).meshes.at(0).failure, "");
  const Asset asset = io::read_gltf(request.out).asset;
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  EXPECT_EQ(asset.mesh.vertices.size(), static_cast<std::size_t>(file.vertex_count()));

  request.learned = anymate_steps(small_models(kJoints, "", ""), {});
  EXPECT_FALSE(request.learned.bind) << "geodesic voxels do that";
  EXPECT_EQ(rig::rig_meshes(request).meshes.at(0).failure, "");
  EXPECT_FALSE(anymate_steps(small_models("", "", kSkin), {}).propose);
}

}  // namespace
}  // namespace anigen::pipeline
