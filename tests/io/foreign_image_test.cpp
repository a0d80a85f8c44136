#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "anigen/core/error.h"
#include "anigen/io/foreign_image.h"
#include "tests/support/picture_files.h"

namespace anigen::io {

namespace {

std::vector<std::uint8_t> file_of(const char* extension, const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(extension, picture, bytes)) throw std::runtime_error("OpenCV cannot encode the test picture");
  return bytes;
}

cv::Mat noise(int type) {
  cv::Mat picture(60, 90, type);
  cv::randu(picture, 0.0, picture.depth() == CV_32F ? 1.0 : 255.0);
  return picture;
}

TEST(ForeignImage, IsWhatDecodeImageGives) {
  // OpenCV's threads, which the decoding process lacks, are at work here first.
  cv::Mat blurred;
  cv::GaussianBlur(cv::Mat(2000, 2000, CV_8UC3, cv::Scalar(1, 2, 3)), blurred, {9, 9}, 2.0);
  const std::pair<const char*, int> kinds[] = {{".png", CV_8UC1},  {".png", CV_8UC4},  {".png", CV_16UC4},
                                               {".jpg", CV_8UC3},  {".webp", CV_8UC4}, {".bmp", CV_8UC3},
                                               {".tif", CV_16UC3}, {".tif", CV_32FC3}};
  for (const auto& [extension, type] : kinds) {
    const std::vector<std::uint8_t> bytes = file_of(extension, noise(type));
    StoredPixels stored, foreign_stored;
    const Image expected = decode_image(bytes, "ours", &stored);
    const Image found = decode_foreign_image(bytes, "foreign", &foreign_stored);
    EXPECT_EQ(found.width, 90);
    EXPECT_EQ(found.height, 60);
    EXPECT_EQ(found.rgba, expected.rgba) << extension << ' ' << type;
    EXPECT_EQ(foreign_stored.channels, stored.channels);
    EXPECT_EQ(foreign_stored.bits, stored.bits);
  }
}

TEST(ForeignImage, LargePicturesFitTheLimits) {
  const std::vector<std::uint8_t> bytes =
      file_of(".png", cv::Mat(3000, 2500, CV_16UC4, cv::Scalar(0, 257, 514, 65535)));
  const Image image = decode_foreign_image(bytes, "large.png");
  EXPECT_EQ(image.height, 3000);
  EXPECT_EQ(image.pixel(2499, 2999)[0], 2);
}

TEST(ForeignImage, RefusalsNameTheFileAndSayTheSame) {
  const std::vector<std::uint8_t> png = encode_png(Image(40, 40));
  std::vector<std::uint8_t> damaged = png, wide = png;
  for (std::size_t i = 45; i + 30 < damaged.size(); ++i) damaged[i] ^= 0x55;
  wide[16] = 1;  // 16,777,256 pixels
  for (const std::vector<std::uint8_t>& bytes :
       {damaged, wide, test::grey_tiff(20000, 20000, {1, 2, 3}), {}, {'n', 'o'}, {png.begin(), png.begin() + 50}}) {
    std::string expected = "accepted", found = "accepted";
    try {
      decode_image(bytes, "wing.png");
    } catch (const InputError& error) {
      expected = error.what();
    }
    try {
      decode_foreign_image(bytes, "wing.png");
    } catch (const InputError& error) {
      found = error.what();
    }
    EXPECT_EQ(found, expected);
    EXPECT_NE(found, "accepted");
  }
}

}  // namespace

}  // namespace anigen::io
