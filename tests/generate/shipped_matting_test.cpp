#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/core/random.h"
#include "anigen/creatures/body.h"
#include "anigen/data/backgrounds.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/generate/evaluate_matting.h"
#include "anigen/generate/trained_matting.h"
#include "anigen/render/picture.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

// The network that comes with the programs finds creatures that no training saw, before backgrounds that are drawn.
TEST(ShippedMatting, CutsUnseenCreaturesOut) {
  constexpr int kSide = 256, kCreatures = 12;
  TrainedMatting network(test::source_dir() / "weights/anigen-small/matting");
  Rng rng(7, "shipped matting");
  double sum = 0.0;
  for (int i = 0; i < kCreatures; ++i) {
    const Asset creature = creatures::make_creature(creature_seeds::kFirstTest + 5, static_cast<std::uint64_t>(i));
    render::PictureOptions options;
    options.width = options.height = kSide;
    options.background.reset();
    const data::PlacedObject object =
        data::place_object(render::render(creature, options), kSide, rng.uniform(0.7, 1.0), 0.5, 0.5, rng.chance(0.5));
    const std::vector<float> planes = data::before_background(object, data::draw_background(kSide, rng));
    io::Image picture(kSide, kSide);
    const std::size_t pixels = object.alpha.size();
    for (std::size_t p = 0; p < pixels; ++p) {
      for (std::size_t c = 0; c < 3; ++c) {
        const float value = std::min(1.0F, std::max(0.0F, planes[c * pixels + p]));
        picture.rgba[io::kImageChannels * p + c] = static_cast<std::uint8_t>(255.0F * value + 0.5F);
      }
      picture.rgba[io::kImageChannels * p + 3] = 255;
    }
    sum += matting_score(network.mask(picture, "creature " + std::to_string(i)), object.alpha).iou;
  }
  // Twelve pictures scatter by about 0.1 each; their mean lies well above what a box around the object would score.
  EXPECT_GT(sum / kCreatures, 0.8);
}

}  // namespace
}  // namespace anigen::generate
