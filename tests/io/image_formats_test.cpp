// Kinds of picture files that people have and OpenCV does not write.
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "anigen/core/error.h"
#include "anigen/io/image.h"
#include "anigen/io/image_probe.h"
#include "tests/support/picture_files.h"

namespace anigen::io {
namespace {

using test::FileBytes;

std::vector<int> channels(const Image& image, int x, int y) {
  const std::uint8_t* pixel = image.pixel(x, y);
  return {pixel[0], pixel[1], pixel[2], pixel[3]};
}

TEST(ImageFormats, PalettesAreResolvedWithTheirAlpha) {
  const Image image = decode_image(test::palette_png({10, 20, 30, 255}, {200, 100, 50, 77}), "palette");
  ASSERT_EQ(image.width, 2);
  EXPECT_EQ(channels(image, 0, 0), (std::vector<int>{10, 20, 30, 255}));
  EXPECT_EQ(channels(image, 1, 0), (std::vector<int>{200, 100, 50, 77}));
}

TEST(ImageFormats, InksBecomeColours) {
  const auto color = [](const std::array<std::uint8_t, 4>& inks) {
    return channels(decode_image(test::cmyk_jpeg(inks), "print"), 3, 5);
  };
  const auto expect_near = [](const std::vector<int>& found, const std::vector<int>& wanted) {
    for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR(found[c], wanted[c], 2) << "channel " << c;
  };
  expect_near(color({255, 255, 255, 255}), {255, 255, 255, 255});  // no ink
  expect_near(color({255, 0, 0, 255}), {255, 0, 0, 255});          // magenta and yellow: red
  expect_near(color({0, 255, 255, 255}), {0, 255, 255, 255});      // cyan
  expect_near(color({255, 255, 255, 128}), {128, 128, 128, 255});  // half of black
  expect_near(color({128, 255, 255, 128}), {64, 128, 128, 255});
}

TEST(ImageFormats, TransparentWebPAndDeepTiff) {
  FileBytes webp, tiff;
  ASSERT_TRUE(cv::imencode(".webp", cv::Mat(9, 7, CV_8UC4, cv::Scalar(30, 60, 90, 120)), webp,
                           {cv::IMWRITE_WEBP_QUALITY, 101}));  // above 100: without loss
  EXPECT_EQ(channels(decode_image(webp, "webp"), 3, 4), (std::vector<int>{90, 60, 30, 120}));
  ASSERT_TRUE(cv::imencode(".tif", cv::Mat(9, 7, CV_16UC3, cv::Scalar(0, 257 * 9, 65535)), tiff));
  EXPECT_EQ(channels(decode_image(tiff, "tiff"), 3, 4), (std::vector<int>{255, 9, 0, 255}));
  EXPECT_EQ(channels(decode_image(test::grey_tiff(3, 1, {7, 8, 9}), "tiff"), 1, 0), (std::vector<int>{8, 8, 8, 255}));
}

TEST(ImageFormats, AHugeTiffIsRefusedByItsHeader) {
  const FileBytes tiff = test::grey_tiff(20000, 20000, {1, 2, 3});
  const PictureSize size = probe_picture(tiff, "scan.tif");
  EXPECT_TRUE(size.known);
  EXPECT_EQ(size.width, 20000u);
  try {
    decode_image(tiff, "scan.tif");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(error.problem().find("20000 x 20000"), std::string::npos) << error.what();
  }
  for (std::size_t length = 0; length < 120; ++length) {
    const FileBytes part(tiff.begin(), tiff.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_THROW(decode_image(part, "scan.tif"), InputError) << length;
  }
}

}  // namespace
}  // namespace anigen::io
