#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/random.h"
#include "anigen/creatures/body.h"
#include "anigen/data/matting_dataset.h"
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
  for (const auto& entry : std::filesystem::directory_iterator(shipped_folder())) {
    if (!entry.is_directory()) continue;
    ++runs;
    EXPECT_EQ(first_incomplete(describe_weights(entry.path())), "") << entry.path();
    for (const auto& file : std::filesystem::recursive_directory_iterator(entry.path()))
      bytes += file.is_regular_file() ? file.file_size() : 0;
  }
  EXPECT_GE(runs, 1);
  EXPECT_LE(bytes, 48U << 20);
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
