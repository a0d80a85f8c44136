#include "anigen/generate/trained_skin.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/data/skin_correction_dataset.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/generate/run_weights.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/rigging/skin_features.h"
#include "anigen/skin_correction/network.h"
#include "tests/data/limb_dataset.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

/// A run of a correction that gives a mixture of the classical weights, raised to a power.
void write_correction(const fs::path& run, double sharpening, const std::string& fold = "",
                      const std::string& data = "") {
  const torch::NoGradGuard no_grad;
  skin_correction::SkinCorrectionOptions options;
  options.candidates = 5;
  options.geovoxel_resolution = 32;
  options.width = 16;
  options.num_heads = 2;
  torch::manual_seed(4);
  skin_correction::SkinCorrection model(options);
  for (auto& entry : model->named_parameters()) {
    if (entry.key().find("sharpening.bias") != std::string::npos) entry.value().fill_(sharpening);
  }
  Json config = {
      {"models",
       {{"skin_correction", {{"name", skin_correction::kSkinCorrectionClass}, {"args", options.to_json()}}}}}};
  if (!fold.empty())
    config["dataset"] = {{"name", "AniGenSkinCorrections"}, {"args", {{"fold", fold}, {"data_dir", data}}}};
  fs::create_directories(run / "ckpts");
  write_file_atomically(run / "config.json", config.dump(2));
  io::write_safetensors(run / "ckpts/skin_correction_step0000001.safetensors", nn::state_dict(*model));
}

class TrainedSkins : public ::testing::Test {
 protected:
  TrainedSkins() { write_correction(run(), 0.0); }

  fs::path run() const { return folder_ / "skin_correction"; }
  static void expect_error(const std::function<void()>& use, const std::string& words) {
    try {
      use();
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }

  test::TemporaryFolder folder_;
};

TEST_F(TrainedSkins, BindAMesh) {
  const test::Body body = test::two_fingers();
  TrainedSkin skin(run());
  const SkinWeights four = skin.bind(body.mesh, body.skeleton, 4);
  test::expect_sound(four, body);
  EXPECT_EQ(skin.bind(body.mesh, body.skeleton, 1).largest_row(), 1U);
  write_correction(folder_ / "sharp", 2.0);
  const SkinWeights sharp = TrainedSkin(folder_ / "sharp").bind(body.mesh, body.skeleton, 4);
  std::size_t sharper = 0;
  for (std::size_t v = 0; v < sharp.rows(); ++v) sharper += sharp.row(v)->weight >= four.row(v)->weight ? 1 : 0;
  EXPECT_GT(static_cast<double>(sharper), 0.99 * static_cast<double>(sharp.rows()));
}

TEST_F(TrainedSkins, AreAStepOfRiggingMeshes) {
  const rigging::LearnedSteps steps = TrainedSkin::steps(std::make_shared<TrainedSkin>(run()), 4);
  EXPECT_FALSE(steps.propose);
  io::RiggedShape shape("limb", "limb.glb");
  shape.mesh = test::two_bones().mesh;
  test::expect_sound(steps.bind(shape, test::two_bones().skeleton), test::two_bones());
}

TEST_F(TrainedSkins, OtherFoldersAreRefused) {
  expect_error([&] { TrainedSkin{folder_.path()}; }, folder_.path().string());
  write_file_atomically(run() / "ckpts/skin_correction_step0000001.safetensors", "damaged");
  expect_error([&] { TrainedSkin{run()}; }, "skin_correction_step0000001.safetensors");
  write_correction(folder_ / "later", 0.0);
  Json config = read_json(folder_ / "later/config.json");
  config["models"]["skin_correction"]["args"]["feature_version"] = 99;
  write_file_atomically(folder_ / "later/config.json", config.dump());
  expect_error([&] { TrainedSkin{folder_ / "later"}; }, "feature_version");
}

TEST_F(TrainedSkins, ShippedWeightsHaveOneOrNot) {
  ::setenv("ANIGEN_WEIGHTS", folder_.path().c_str(), 1);
  EXPECT_EQ(shipped_skin_correction().string(), run().string());
  fs::remove_all(run());
  EXPECT_TRUE(shipped_skin_correction().empty());
  ::unsetenv("ANIGEN_WEIGHTS");
}

TEST_F(TrainedSkins, TheirWeightsCanBeInspected) {
  const Json found = describe_weights(run())["skin_correction"];
  EXPECT_EQ(found["class"], skin_correction::kSkinCorrectionClass);
  EXPECT_TRUE(found["complete"].get<bool>()) << found.dump();
}

TEST_F(TrainedSkins, AreScoredBesideTheWeightsThatTheyCorrect) {
  test::write_limb_dataset(folder_ / "data", 2);
  eval::SkinRequest request;
  request.dataset = folder_ / "data";
  request.out = folder_ / "scores";
  request.poses = 2;
  request.report = false;
  request.methods = skin_correction_methods({run()}, request.settings);
  const eval::SkinEvaluation evaluation = eval::run_skin_evaluation(request);
  ASSERT_EQ(evaluation.assets.size(), 2U);
  for (const eval::AssetResult& asset : evaluation.assets) {
    for (std::size_t m = 0; m < 5; ++m) {
      EXPECT_TRUE(asset.methods[m].failure.empty()) << evaluation.methods[m].key << asset.methods[m].failure;
      EXPECT_GT(asset.methods[m].deformation, 0.0) << evaluation.methods[m].key;
    }
    // A mixture of two is no worse than the worse one.
    EXPECT_LE(asset.methods[0].scores.mean.l1,
              std::max(asset.methods[2].scores.mean.l1, asset.methods[3].scores.mean.l1) + 1e-3);
  }
  EXPECT_NE(read_file(folder_ / "scores/table.md").find("Means over skeletons"), std::string::npos);
  EXPECT_NE(read_file(folder_ / "scores/metrics.csv").find("deformation"), std::string::npos);
}

TEST_F(TrainedSkins, OfFoldsEachRealRigGetsTheRunThatHasNotSeenIt) {
  test::write_limb_dataset(folder_ / "data", 6);
  write_correction(folder_ / "fold0", 0.0, "0/2");
  write_correction(folder_ / "fold1", 3.0, "1/2");
  Json settings = Json::object();
  const auto methods = skin_correction_methods({folder_ / "fold0", folder_ / "fold1"}, settings);
  const auto only = skin_correction_methods({folder_ / "fold0"}, settings);
  for (const io::DatasetItem& item : io::list_dataset(folder_ / "data")) {
    const eval::GroundTruth truth = eval::read_ground_truth(folder_ / "data", item.id);
    const bool creature = item.source != "real";
    const bool first = creature || data::SkeletonFold{0, 2}.holds(tree_signature(truth.parents));
    const std::vector<float> weights = methods[0].predict(item, truth);
    TrainedSkin run(folder_ / (first ? "fold0" : "fold1"));
    Mesh mesh;
    mesh.vertices = truth.vertices;
    mesh.faces = truth.faces;
    std::vector<Eigen::Vector3d> joints;
    for (const Eigen::Vector3f& joint : truth.joints) joints.push_back(joint.cast<double>());
    const SkinWeights expected = run.bind(mesh, skeleton_from_joints(joints, truth.parents), 4);
    EXPECT_EQ(weights, to_dense(expected, truth.joints.size())) << item.id;
    if (!first) expect_error([&] { only[0].predict(item, truth); }, "held its skeleton out");
  }
  write_correction(folder_ / "again", 0.0, "0/2");
  write_correction(folder_ / "of_three", 0.0, "1/3");
  expect_error([&] { skin_correction_methods({folder_ / "fold0", folder_ / "again"}, settings); }, "another run");
  expect_error([&] { skin_correction_methods({folder_ / "fold0", folder_ / "of_three"}, settings); }, "folds");
  expect_error([&] { skin_correction_methods({folder_ / "fold0", run()}, settings); }, "fold of its own");
  expect_error([&] { skin_correction_methods({}, settings); }, "--skin-run");
}

TEST_F(TrainedSkins, FoldsFollowTheTreesOfTheTraining) {
  // Evaluated with joints that the training's repairs had merged: its tree decides who has not seen the rig.
  test::write_limb_dataset(folder_ / "trained", 1);
  test::write_limb_dataset(folder_ / "evaluated", 1);
  const std::string trained = (folder_ / "trained").string();
  const io::DatasetItem item = io::list_dataset(folder_ / "evaluated").front();
  const std::string own = data::skeleton_signature_of({trained, item.id});
  int joints = 3;
  do {
    test::write_limb(folder_ / "evaluated/skeleton" / item.id / "skeleton_voxelized.npz", ++joints, 0.05);
  } while (data::SkeletonFold{0, 2}.holds(data::skeleton_signature_of({folder_ / "evaluated", item.id})) ==
           data::SkeletonFold{0, 2}.holds(own));
  const std::string held = data::SkeletonFold{0, 2}.holds(own) ? "0/2" : "1/2", seen = held == "0/2" ? "1/2" : "0/2";
  write_correction(folder_ / "held", 0.0, held, "/gone," + trained);
  write_correction(folder_ / "seen", 0.0, seen, "/gone," + trained);
  Json settings = Json::object();
  const eval::GroundTruth truth = eval::read_ground_truth(folder_ / "evaluated", item.id);
  EXPECT_FALSE(skin_correction_methods({folder_ / "held"}, settings)[0].predict(item, truth).empty());
  expect_error([&] { skin_correction_methods({folder_ / "seen"}, settings)[0].predict(item, truth); },
               "held its skeleton out");
}

}  // namespace
}  // namespace anigen::generate
