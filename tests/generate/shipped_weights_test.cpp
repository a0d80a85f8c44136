#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/random.h"
#include "anigen/creatures/body.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/nn/state_dict.h"
#include "anigen/render/picture.h"
#include "anigen/vision/picture_estimator.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

std::filesystem::path shipped_folder() { return test::source_dir() / "weights/anigen-small"; }

// Every model that a shipped config names has all its weights, and the whole stays below what the repository allows.
TEST(ShippedWeights, AreComplete) {
  std::uintmax_t bytes = 0;
  int runs = 0;
  for (const auto& file : std::filesystem::recursive_directory_iterator(shipped_folder())) {
    bytes += file.is_regular_file() ? file.file_size() : 0;
    if (file.path().filename() != "config.json") continue;
    ++runs;
    const std::filesystem::path run = file.path().parent_path();
    EXPECT_EQ(first_incomplete(describe_weights(run)), "") << run;
  }
  EXPECT_GE(runs, 1);
  EXPECT_LE(bytes, 48U << 20);
}

double mean_nearest(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to) {
  double sum = 0.0;
  for (const Eigen::Vector3d& a : from) {
    double nearest = 1.0;
    for (const Eigen::Vector3d& b : to) nearest = std::min(nearest, (a - b).norm());
    sum += nearest;
  }
  return sum / static_cast<double>(from.size());
}

// 50 creatures of the test have .026; the limit leaves room for which ones these are.
TEST(ShippedWeights, FlowsFindTheJointsOfUnseenCreatures) {
  constexpr int kCreatures = 6;
  constexpr std::uint64_t kSeed = creature_seeds::kFirstTest + 7;
  FieldRigger::Request request;
  request.flows = {shipped_folder() / "rig/ss_flow", shipped_folder() / "rig/slat_flow"};
  FieldRigger rigger(request);
  double j2j = 0.0;
  for (std::uint64_t i = 0; i < kCreatures; ++i) {
    Asset creature = creatures::make_creature(kSeed, i);
    normalize(creature);
    io::RiggedShape shape;
    shape.id = shape.file = "creature";
    shape.mesh.vertices = creature.mesh.vertices;
    shape.mesh.faces = creature.mesh.faces;
    const std::vector<Eigen::Vector3d> found = rigger.find(shape).skeleton.positions(),
                                       own = creature.skeleton.positions();
    j2j += 0.5 * (mean_nearest(found, own) + mean_nearest(own, found)) / kCreatures;
  }
  EXPECT_LT(j2j, 0.06);
}

// Pictures of creatures that no training saw, on black and cropped as condition views are.
torch::Tensor unseen_picture(const Asset& creature, int side, Rng& rng) {
  render::PictureOptions options;
  options.width = options.height = 2 * side;
  options.background.reset();
  const data::PlacedObject object =
      data::place_object(render::render(creature, options), side, 1.0 / 1.2, 0.5, 0.5, rng.chance(0.5));
  return torch::tensor(object.color).view({1, 3, side, side});
}

TEST(ShippedWeights, PictureEstimatorTellsFamiliesOfUnseenCreatures) {
  constexpr int kCreatures = 45;
  const torch::NoGradGuard no_grad;
  const std::filesystem::path run = shipped_folder() / "picture_estimator";
  auto network =
      nn::load_trained<vision::PictureEstimator>(nn::find_run_model(run, vision::kPictureEstimatorClass), torch::kCPU);
  const std::vector<std::string> families = read_json(run / "config.json")["dataset"]["args"]["families"];
  Rng rng(11, "shipped estimator");
  int right = 0;
  for (std::uint64_t i = 0; i < kCreatures; ++i) {
    constexpr std::uint64_t kSeed = creature_seeds::kFirstTest + 6;
    const torch::Tensor picture =
        unseen_picture(creatures::make_creature(kSeed, i), static_cast<int>(network->options().image_size), rng);
    const auto found = static_cast<std::size_t>(network->forward(picture).family.argmax(1).item<std::int64_t>());
    right += families.at(found) == "procedural:" + creatures::creature_family(kSeed, i) ? 1 : 0;
  }
  // Chance would be 3 of 45. Light and view differ from the training's pictures.
  EXPECT_GE(right, kCreatures * 2 / 3);
}

}  // namespace
}  // namespace anigen::generate
