#include "anigen/data/backgrounds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "tests/data/disc_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

constexpr int kEdge = 24;
constexpr std::size_t kPlane = kEdge * kEdge;

std::vector<float> drawn(Background kind, std::uint64_t seed) {
  Rng rng(seed, "background");
  return draw_background(kind, kEdge, rng);
}

void expect_colors(const std::vector<float>& planes, const std::string& what) {
  ASSERT_EQ(planes.size(), 3 * kPlane) << what;
  // Interpolated and blurred colours may pass 1 by rounding.
  EXPECT_GE(*std::min_element(planes.begin(), planes.end()), -1e-5F) << what;
  EXPECT_LE(*std::max_element(planes.begin(), planes.end()), 1.0F + 1e-5F) << what;
}

TEST(DrawnBackgrounds, AreFunctionsOfTheSeed) {
  for (const auto& [kind, name] : kBackgrounds) {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const std::vector<float> planes = drawn(kind, seed);
      expect_colors(planes, name);
      EXPECT_EQ(planes, drawn(kind, seed)) << name;
      EXPECT_NE(planes, drawn(kind, seed + 1)) << name;
    }
  }
}

TEST(DrawnBackgrounds, AllKindsAreDrawnAndAllButOneVary) {
  const std::vector<float> flat = drawn(Background::kFlat, 3);
  EXPECT_EQ(*std::min_element(flat.begin(), flat.begin() + kPlane),
            *std::max_element(flat.begin(), flat.begin() + kPlane));
  for (const auto& [kind, name] : kBackgrounds) {
    if (kind == Background::kFlat) continue;
    int varied = 0;
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const std::vector<float> planes = drawn(kind, seed);
      const auto [least, most] = std::minmax_element(planes.begin(), planes.begin() + kPlane);
      varied += *most - *least > 0.01F ? 1 : 0;
    }
    EXPECT_GE(varied, 10) << name << ": two colours may be near to each other, seldom equal";
  }
  Rng rng(4, "any");
  EXPECT_NE(draw_background(kEdge, rng), draw_background(kEdge, rng)) << "the generator moves on";
}

TEST(PictureBackgrounds, AreSquaresOfThePicture) {
  io::Image picture(60, 40);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 60; ++x) {
      const std::uint8_t color[] = {static_cast<std::uint8_t>(4 * x), static_cast<std::uint8_t>(6 * y), 77, 255};
      std::copy(color, color + 4, picture.pixel(x, y));
    }
  }
  bool rises = false, falls = false;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng one(seed, "crop"), again(seed, "crop");
    const std::vector<float> planes = crop_background(picture, kEdge, one);
    expect_colors(planes, "crop");
    EXPECT_EQ(planes, crop_background(picture, kEdge, again));
    for (std::size_t i = 2 * kPlane; i < 3 * kPlane; ++i) EXPECT_NEAR(planes[i], 77 / 255.0, 1e-4);
    const std::size_t middle = kEdge / 2 * kEdge;
    (planes[middle + kEdge - 1] > planes[middle] ? rises : falls) = true;
    EXPECT_GT(planes[kPlane + kEdge * (kEdge - 1)], planes[kPlane]) << "never upside down";
  }
  EXPECT_TRUE(rises && falls) << "some are mirrored";
}

TEST(BlurredPlanes, KeepTheirMeanAndLoseTheirContrast) {
  std::vector<float> planes(3 * kPlane, 0.0F), sharp;
  for (std::size_t i = 0; i < planes.size(); i += 2) planes[i] = 1.0F;
  sharp = planes;
  blur_planes(planes, kEdge, 0.0);
  EXPECT_EQ(planes, sharp);
  blur_planes(planes, kEdge, 2.0);
  for (const float value : planes) EXPECT_NEAR(value, 0.5F, 0.05F);
}

// Every tap of the kernel in double, one place after the other.
std::vector<double> slowly_blurred(const std::vector<float>& plane, int size, double sigma) {
  const int radius = (static_cast<int>(std::lround(8.0 * sigma + 1.0)) | 1) / 2;
  const auto mirrored = [&](int place) {
    while (size > 1 && (place < 0 || place >= size)) place = place < 0 ? -place : 2 * (size - 1) - place;
    return size > 1 ? place : 0;
  };
  double sum = 0.0;
  for (int k = -radius; k <= radius; ++k) sum += std::exp(-0.5 * k * k / (sigma * sigma));
  std::vector<double> from(plane.begin(), plane.end()), to(from.size());
  for (const bool along_rows : {true, false}) {
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        double& value = to[static_cast<std::size_t>(size * y + x)];
        value = 0.0;
        for (int k = -radius; k <= radius; ++k) {
          const int place = along_rows ? size * y + mirrored(x + k) : size * mirrored(y + k) + x;
          value += std::exp(-0.5 * k * k / (sigma * sigma)) / sum * from[static_cast<std::size_t>(place)];
        }
      }
    }
    from = to;
  }
  return from;
}

TEST(BlurredPlanes, AreThoseOfASlowBlurInDouble) {
  Rng rng(9, "plane");
  for (const int size : {1, 2, 3, 17, 32}) {
    for (const double sigma : {0.1, 0.3, 0.8, 1.0, 2.5, 7.0, 30.0}) {
      std::vector<float> planes(at(2 * size * size));
      for (float& value : planes) value = static_cast<float>(rng.uniform());
      const std::vector<float> first(planes.begin(), planes.begin() + size * size);
      const std::vector<float> second(planes.begin() + size * size, planes.end());
      std::vector<double> wanted = slowly_blurred(first, size, sigma);
      const std::vector<double> more = slowly_blurred(second, size, sigma);
      wanted.insert(wanted.end(), more.begin(), more.end());
      blur_planes(planes, size, sigma);
      for (std::size_t i = 0; i < planes.size(); ++i)
        ASSERT_NEAR(planes[i], wanted[i], 1e-5) << size << " pixels, sigma " << sigma << ", place " << i;
    }
  }
}

class PictureFolder : public ::testing::Test {
 protected:
  void expect_refused(bool cut_out, const std::string& file, const std::string& words) {
    try {
      read_pictures(folder_.path(), 64, cut_out);
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), file);
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }

  test::TemporaryFolder folder_;
};

TEST_F(PictureFolder, IsReadByNameAndReduced) {
  io::write_png(folder_ / "b.png", test::disc_cutout(100, 0x102030));
  io::write_png(folder_ / "a.png", io::Image(128, 32, 0x405060FFU));
  std::ofstream(folder_ / "notes.txt") << "no picture";
  const std::vector<io::Image> pictures = read_pictures(folder_.path(), 64, false);
  ASSERT_EQ(pictures.size(), 2U);
  EXPECT_EQ(pictures[0].width, 64);
  EXPECT_EQ(pictures[0].height, 16);
  EXPECT_EQ(pictures[1].width, 64);
  std::filesystem::remove(folder_ / "a.png");
  // The disc's box, 60 pixels wide, with a fifth around it.
  EXPECT_NEAR(read_pictures(folder_.path(), 1000, true)[0].width, 72, 2);
}

TEST_F(PictureFolder, WithoutWhatIsNeededIsRefused) {
  expect_refused(false, folder_.path().string(), "holds no picture");
  io::write_png(folder_ / "opaque.png", io::Image(32, 32, 0x405060FFU));
  expect_refused(true, (folder_ / "opaque.png").string(), "no transparent pixel");
  std::filesystem::remove(folder_ / "opaque.png");
  std::ofstream(folder_ / "broken.png") << "broken";
  expect_refused(false, (folder_ / "broken.png").string(), "cannot be decoded");
}

}  // namespace
}  // namespace anigen::data
