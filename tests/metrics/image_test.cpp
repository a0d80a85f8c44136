#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/image.h"
#include "tests/metrics/align_shapes.h"

namespace anigen::metrics {
namespace {

io::Image noise(int width, int height, std::uint64_t seed) {
  Rng rng(seed, "picture");
  io::Image image(width, height);
  for (std::uint8_t& byte : image.rgba) byte = static_cast<std::uint8_t>(rng.index(256));
  return image;
}

io::Image grey(int size, std::uint8_t value) {
  io::Image image(size, size);
  for (std::size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = i % 4 == 3 ? 255 : value;
  return image;
}

/// The definition, window by window, in two dimensions.
double slow_ssim(const io::Image& a, const io::Image& b) {
  double window[11][11], total = 0.0;
  for (int i = 0; i < 11; ++i) {
    for (int j = 0; j < 11; ++j) {
      window[i][j] = std::exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / (2 * 1.5 * 1.5));
      total += window[i][j];
    }
  }
  double sum = 0.0;
  int count = 0;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y + 11 <= a.height; ++y) {
      for (int x = 0; x + 11 <= a.width; ++x) {
        double ma = 0, mb = 0, va = 0, vb = 0, cov = 0;
        const auto at = [&](const io::Image& image, int i, int j) { return image.pixel(x + j, y + i)[c] / 255.0; };
        for (int i = 0; i < 11; ++i) {
          for (int j = 0; j < 11; ++j) {
            ma += window[i][j] / total * at(a, i, j);
            mb += window[i][j] / total * at(b, i, j);
          }
        }
        for (int i = 0; i < 11; ++i) {
          for (int j = 0; j < 11; ++j) {
            const double w = window[i][j] / total, da = at(a, i, j) - ma, db = at(b, i, j) - mb;
            va += w * da * da;
            vb += w * db * db;
            cov += w * da * db;
          }
        }
        sum += (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
        ++count;
      }
    }
  }
  return sum / count;
}

TEST(Psnr, HandComputedNumbers) {
  EXPECT_NEAR(psnr(grey(8, 100), grey(8, 151)), 20 * std::log10(5.0), 1e-12);  // off by a fifth everywhere
  EXPECT_NEAR(psnr(grey(8, 0), grey(8, 255)), 0.0, 1e-12);
  EXPECT_TRUE(std::isinf(psnr(grey(8, 7), grey(8, 7))));
  io::Image transparent = grey(8, 7);
  for (std::size_t i = 3; i < transparent.rgba.size(); i += 4) transparent.rgba[i] = 0;
  EXPECT_TRUE(std::isinf(psnr(grey(8, 7), transparent)));  // alpha does not count
}

TEST(Ssim, EqualsTheSlowDefinition) {
  const io::Image a = noise(23, 17, 1), b = noise(23, 17, 2);
  EXPECT_NEAR(ssim(a, b), slow_ssim(a, b), 1e-12);
  EXPECT_NEAR(ssim(a, a), 1.0, 1e-12);
  EXPECT_NEAR(ssim(a, b), ssim(b, a), 1e-14);
  // Flat pictures have no structure: only the luminance term is left.
  const double x = 100 / 255.0, y = 151 / 255.0;
  EXPECT_NEAR(ssim(grey(12, 100), grey(12, 151)), (2 * x * y + 1e-4) / (x * x + y * y + 1e-4), 1e-9);
}

TEST(ImageMetrics, RefuseBadInput) {
  EXPECT_THROW(psnr(noise(8, 9, 1), noise(9, 8, 1)), InputError);
  EXPECT_THROW(psnr(io::Image(), io::Image()), InputError);
  EXPECT_THROW(ssim(noise(10, 20, 1), noise(10, 20, 2)), InputError);
  io::Image cut = noise(12, 12, 1);
  cut.rgba.resize(5);
  EXPECT_THROW(ssim(cut, noise(12, 12, 1)), InputError);
  EXPECT_THROW(image_scores({}, {}), InputError);
  EXPECT_THROW(image_scores({grey(12, 1)}, {}), InputError);
}

TEST(Views, TheFrameIsFixedAndTheBackgroundBlack) {
  ViewOptions options;
  options.size = 64;
  const io::RiggedShape shape = test::rigged(test::walker(10));
  const auto views = render_views(shape, {}, options);
  ASSERT_EQ(views.size(), 4u);
  const auto lit = [](const io::Image& image, int from, int to) {
    int count = 0;
    for (int y = 0; y < image.height; ++y) {
      for (int x = from; x < to; ++x) count += image.pixel(x, y)[1] > 0 ? 1 : 0;
    }
    return count;
  };
  for (const io::Image& view : views) {
    EXPECT_EQ(view.pixel(0, 0)[0], 0);
    EXPECT_EQ(view.pixel(0, 0)[3], 255);
    EXPECT_GT(lit(view, 0, 64), 100);
  }
  // The camera does not follow the object: moved to its left, seen from the front, it fills the right half.
  Similarity aside;
  aside.scale = 0.3;
  aside.translation = {0.3, 0, 0};
  const auto moved = render_views(shape, aside, options);
  EXPECT_EQ(lit(moved[0], 0, 32), 0);
  EXPECT_GT(lit(moved[0], 32, 64), 0);
  EXPECT_EQ(lit(moved[2], 32, 64), 0);  // from behind, the left half
  // At distance 2 and 40° a unit reaches 64 / (2 · 2 · tan 20°) pixels: 44; the figure's bounding sphere stays inside.
  EXPECT_EQ(lit(views[0], 0, 6), 0);
}

TEST(Views, ScoresKnowEqualAndDifferentPictures) {
  ViewOptions options;
  options.size = 48;
  const io::RiggedShape shape = test::rigged(test::walker(8));
  const auto truth = render_views(shape, {}, options);
  const ImageScores same = image_scores(truth, truth);
  EXPECT_EQ(same.psnr, kLargestPsnr);
  EXPECT_NEAR(same.ssim, 1.0, 1e-12);
  EXPECT_FALSE(same.lpips.has_value());  // not computed, and not made up
  EXPECT_FALSE(same.encoder.has_value());
  const auto other = render_views(test::rigged(test::crawler(8)), {}, options);
  int calls = 0;
  const ImageScores different = image_scores(
      other, truth, {[&](const io::Image&, const io::Image&) { return static_cast<double>(++calls); }, {}});
  EXPECT_LT(different.psnr, 30.0);
  EXPECT_LT(different.ssim, 0.95);
  EXPECT_EQ(calls, 4);
  EXPECT_DOUBLE_EQ(*different.lpips, 2.5);
}

TEST(Views, RefuseBadInput) {
  io::RiggedShape shape = test::rigged(test::walker(4));
  ViewOptions options;
  options.views = 0;
  EXPECT_THROW(render_views(shape, {}, options), InputError);
  options = {};
  options.size = 0;
  EXPECT_THROW(render_views(shape, {}, options), InputError);
  shape.mesh.vertices[0].x() = NAN;
  EXPECT_THROW(render_views(shape, {}, {}), InputError);
  shape.mesh.faces.clear();
  EXPECT_THROW(render_views(shape, {}, {}), InputError);
}

}  // namespace
}  // namespace anigen::metrics
