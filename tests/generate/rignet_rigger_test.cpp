#include "anigen/generate/rignet_rigger.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/run_weights.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/nn/state_dict.h"
#include "tests/generate/anymate_bar.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::generate {
namespace {

using rignet::Task;

TrainedRignetModel small_rignet_model(Task task) {
  torch::manual_seed(13);
  rignet::RignetOptions options;
  options.task = task;
  options.width = 0.05;
  TrainedRignetModel trained;
  trained.model = rignet::RignetModel(options);
  trained.model->eval();
  trained.file = "rignet-" + name_of(task);
  trained.mesh.most_vertices = 60;
  trained.mesh.geodesic_samples = 100;
  return trained;
}

RignetModels small_rignet_models(bool joints, bool connectivity, bool skin) {
  RignetModels models;
  if (joints) models.joints = small_rignet_model(Task::kJoints);
  if (connectivity) models.connectivity = small_rignet_model(Task::kConnectivity);
  if (skin) models.skin = small_rignet_model(Task::kSkinning);
  return models;
}

/// A ball of 642 vertices with the joints of the bar in it.
io::RiggedShape ball() {
  io::RiggedShape shape;
  shape.id = "ball";
  shape.file = "ball.glb";
  shape.mesh = geometry::icosphere(3, 2.0);
  for (const double x : {-1.0, 0.0, 1.0}) shape.joints.positions.emplace_back(x, 0.1, 0.2);
  shape.joints.parents = {-1, 0, 1};
  shape.joint_names = {"hip", "knee", "foot"};
  return shape;
}

const rigging::JointProposer& joints_of_the_file() {
  static const rigging::JointProposer proposer(rigging::JointSource::kGiven, {});
  return proposer;
}

Asset rigged_by(RignetRigger& rigger, const io::RiggedShape& shape) {
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.skeleton = rigger.propose(shape, joints_of_the_file()).skeleton;
  asset.skin = rigger.bind(shape, asset.skeleton);
  return asset;
}

TEST(RignetRigger, GivesSoundRigsInTheFrameOfTheMesh) {
  RignetRigger rigger(small_rignet_models(true, true, true), {});
  for (const io::RiggedShape& shape : {ball(), bar()}) {
    const Asset asset = rigged_by(rigger, shape);
    EXPECT_EQ(validate(asset), std::vector<std::string>{}) << shape.id;
    EXPECT_EQ(asset.skin.rows(), shape.mesh.vertices.size());
    EXPECT_LE(asset.skin.largest_row(), 4u);
    const Box box = bounding_box(shape.mesh.vertices);
    for (const Eigen::Vector3d& joint : asset.skeleton.positions()) {
      // Simplified vertices may lie a little outside.
      EXPECT_TRUE((joint.array() >= box.low.array() - 0.3).all() && (joint.array() <= box.high.array() + 0.3).all());
    }
    const Asset again = rigged_by(rigger, shape);
    EXPECT_EQ(asset.skeleton.parents, again.skeleton.parents) << "what came before must not matter";
    EXPECT_EQ(to_dense(asset.skin, asset.skeleton.size()), to_dense(again.skin, again.skeleton.size()));
  }
}

TEST(RignetRigger, WithoutConnectivityTheTreeIsTheShortest) {
  RignetRigger rigger(small_rignet_models(true, false, false), {});
  const Skeleton skeleton = rigger.propose(ball(), joints_of_the_file()).skeleton;
  EXPECT_GT(skeleton.size(), 1u);
  const auto shortest = shortest_tree(skeleton.positions());
  double ours = 0.0, theirs = 0.0;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const auto length = [&](int parent) {
      return parent < 0 ? 0.0
                        : (skeleton.positions()[j] - skeleton.positions()[static_cast<std::size_t>(parent)]).norm();
    };
    ours += length(skeleton.parents[j]);
    theirs += length(shortest[j]);
  }
  EXPECT_NEAR(ours, theirs, 1e-6);
}

TEST(RignetRigger, GivenJointsKeepTheirPlacesAndNames) {
  RignetRigger connects(small_rignet_models(false, true, false), {});
  const Skeleton skeleton = connects.propose(ball(), joints_of_the_file()).skeleton;
  ASSERT_EQ(skeleton.size(), 3u);
  for (std::size_t j = 0; j < 3; ++j) {
    const double x = skeleton.names[j] == "hip" ? -1.0 : skeleton.names[j] == "knee" ? 0.0 : 1.0;
    EXPECT_LT((skeleton.positions()[j] - Eigen::Vector3d(x, 0.1, 0.2)).norm(), 1e-6);
  }
  RignetRigger binds(small_rignet_models(false, false, true), {});
  EXPECT_EQ(binds.propose(ball(), joints_of_the_file()).skeleton.parents, (std::vector<int>{-1, 0, 1}));
  const Asset asset = rigged_by(binds, ball());
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  io::RiggedShape bare = ball();
  bare.mesh.faces.clear();
  EXPECT_THROW(binds.propose(bare, joints_of_the_file()), InputError);
}

TEST(RignetRigger, NumbersThatAreNotFiniteAreAnError) {
  RignetModels models = small_rignet_models(true, true, true);
  for (auto* trained : {&models.joints, &models.connectivity, &models.skin}) {
    const torch::NoGradGuard no_grad;
    for (torch::Tensor& parameter : (*trained)->model->parameters()) parameter.fill_(std::nanf(""));
  }
  const io::RiggedShape shape = ball();
  RignetModels only_joints, only_tree, only_skin;
  only_joints.joints = models.joints;
  only_tree.connectivity = models.connectivity;
  only_skin.skin = models.skin;
  EXPECT_THROW(RignetRigger(only_joints, {}).propose(shape, joints_of_the_file()), InputError);
  EXPECT_THROW(RignetRigger(only_tree, {}).propose(shape, joints_of_the_file()), InputError);
  RignetRigger binds(only_skin, {});
  const Skeleton chain = binds.propose(shape, joints_of_the_file()).skeleton;
  EXPECT_THROW(binds.bind(shape, chain), InputError);
}

TEST(RignetRigger, WorksAsStepsOfTheOtherRigger) {
  const test::TemporaryFolder folder;
  const test::RigFile file;
  test::write_glb(folder / "mesh.glb", file);
  rigging::RigRequest request;
  request.meshes = folder / "mesh.glb";
  request.out = folder / "rigged.glb";
  request.learned = LearnedRigger::steps(
      std::make_shared<RignetRigger>(small_rignet_models(true, true, true), RignetRiggerOptions()));
  EXPECT_EQ(rigging::rig_meshes(request).meshes.at(0).failure, "");
  EXPECT_EQ(validate(io::read_gltf(request.out).asset), std::vector<std::string>{});
  EXPECT_FALSE(LearnedRigger::steps(
                   std::make_shared<RignetRigger>(small_rignet_models(true, false, false), RignetRiggerOptions()))
                   .bind)
      << "geodesic voxels do that";
  EXPECT_FALSE(LearnedRigger::steps(
                   std::make_shared<RignetRigger>(small_rignet_models(false, false, true), RignetRiggerOptions()))
                   .propose);
}

TEST(RignetModels, AreReadFromRunsAndMustFitTheirPlaces) {
  const test::TemporaryFolder folder;
  torch::manual_seed(2);
  const Json args = {{"task", "skin"}, {"width", 0.05}};
  rignet::RignetModel model(rignet::RignetOptions::from_json(args));
  const Json config = {{"models", {{"model", {{"name", "RignetModel"}, {"args", args}}}}},
                       {"dataset", {{"name", "Rignet"}, {"args", {{"most_vertices", 77}}}}},
                       {"trainer", {{"name", "RignetTrainer"}, {"args", Json::object()}}}};
  write_file_atomically(folder / "config.json", config.dump());
  std::filesystem::create_directories(folder / "ckpts");
  const auto weights = folder / "ckpts" / "model_step0000005.safetensors";
  io::write_safetensors(weights, nn::state_dict(*model));

  for (const std::filesystem::path& path : {folder.path(), std::filesystem::path(weights)}) {
    const TrainedRignetModel found = load_rignet_model(path, torch::kCPU);
    EXPECT_EQ(found.mesh.most_vertices, 77u);
    EXPECT_FALSE(found.model->is_training());
    EXPECT_TRUE(torch::equal(found.model->parameters()[0], model->parameters()[0]));
  }
  EXPECT_EQ(first_incomplete(describe_weights(folder.path())), "");
  try {
    load_rignet_models({folder.path(), {}, {}}, torch::kCPU);
    FAIL() << "a model for skinning in the place of joints";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("is for skinning, not for joints"), std::string::npos) << error.what();
  }
  EXPECT_THROW(load_rignet_model(folder / "nothing", torch::kCPU), InputError);
}

}  // namespace
}  // namespace anigen::generate
