#include "anigen/generate/grabcut.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "tests/support/paths.h"

#include <opencv2/core.hpp>

namespace anigen::generate {
namespace {

std::uint8_t with_noise(double value, double deviation, Rng& rng) {
  return static_cast<std::uint8_t>(std::clamp(value + deviation * rng.normal(), 0.0, 255.0));
}

/// A background that gets brighter from top to bottom, and noise.
io::Image background(int width, int height, Rng& rng) {
  io::Image image(width, height);
  for (int y = 0; y < height; ++y) {
    const double grey = 70.0 + 90.0 * y / height;
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) image.pixel(x, y)[c] = with_noise(grey + 5.0 * c, 4.0, rng);
    }
  }
  return image;
}

double overlap(const std::vector<std::uint8_t>& mask, const std::vector<bool>& object) {
  int both = 0, either = 0;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    both += mask[i] > 127 && object[i];
    either += mask[i] > 127 || object[i];
  }
  return static_cast<double>(both) / either;
}

TEST(GrabCut, FindsATexturedObject) {
  Rng rng(3, "picture");
  io::Image image = background(330, 250, rng);
  std::vector<bool> object(330 * 250, false);
  for (int y = 0; y < 250; ++y) {
    for (int x = 0; x < 330; ++x) {
      const bool body = std::pow((x - 150) / 90.0, 2) + std::pow((y - 140) / 50.0, 2) < 1.0;
      const bool leg = x > 100 && x < 125 && y > 140 && y < 230;
      if (!body && !leg) continue;
      object[static_cast<std::size_t>(330 * y + x)] = true;
      const bool stripe = (x + 2 * y) / 17 % 2 == 0;
      const double color[3] = {stripe ? 200.0 : 120.0, stripe ? 140.0 : 40.0, 30.0};
      for (int c = 0; c < 3; ++c) image.pixel(x, y)[c] = with_noise(color[c], 8.0, rng);
    }
  }
  const std::vector<std::uint8_t> mask = grabcut_mask(image);
  EXPECT_GT(overlap(mask, object), 0.9);

  cv::theRNG().state = 99;
  EXPECT_EQ(grabcut_mask(image), mask) << "depends on what drew random numbers before";
  EXPECT_EQ(cv::theRNG().state, 99u) << "disturbs what draws random numbers after";
}

TEST(GrabCut, FindsARealObjectOnAPlainWall) {
  const std::filesystem::path file = test::assets_dir() / "images" / "block_robot.png";
  if (!std::filesystem::exists(file)) {
    GTEST_SKIP() << "no picture " << file;
  }
  const io::Image cutout = io::read_image(file);
  Rng rng(4, "wall");
  io::Image image = background(cutout.width, cutout.height, rng);
  std::vector<bool> object;
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
    const double alpha = cutout.rgba[i + 3] / 255.0;
    object.push_back(alpha > 0.5);
    for (std::size_t c = 0; c < 3; ++c) {
      image.rgba[i + c] =
          static_cast<std::uint8_t>(cutout.rgba[i + c] * alpha + image.rgba[i + c] * (1.0 - alpha) + 0.5);
    }
  }
  EXPECT_GT(overlap(grabcut_mask(image), object), 0.9);
}

TEST(GrabCut, FindsNothingWhereNothingStandsOut) {
  const auto is_empty = [](const io::Image& image) {
    const std::vector<std::uint8_t> mask = grabcut_mask(image);
    EXPECT_EQ(mask.size(), image.rgba.size() / 4);
    return std::all_of(mask.begin(), mask.end(), [](std::uint8_t alpha) { return alpha == 0; });
  };
  EXPECT_TRUE(is_empty(io::Image(64, 40, 0x336699FFu)));
  EXPECT_TRUE(is_empty(io::Image(2, 2)));
  EXPECT_TRUE(is_empty(io::Image(2000, 1)));
  EXPECT_TRUE(is_empty(io::Image()));
}

}  // namespace
}  // namespace anigen::generate
