#include "anigen/io/picture_codec.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/support/paths.h"

// stb's codec, which lean builds use, beside OpenCV's.

namespace anigen::io {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Outcome = PictureCodec::Outcome;

Image noisy(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  Image image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < kImageChannels; ++c)
        image.pixel(x, y)[c] =
            static_cast<std::uint8_t>((3 * x + 5 * y + 40 * c + static_cast<int>(random() % 9)) % 256);
    }
  }
  return image;
}

Bytes encoded_by_opencv(const char* extension, const cv::Mat& picture) {
  Bytes bytes;
  if (!cv::imencode(extension, picture, bytes)) throw std::runtime_error("OpenCV cannot encode the test picture");
  return bytes;
}

/// Both codecs on one file. @param within grey levels
void expect_alike(const Bytes& bytes, int within, const std::string& name) {
  Image ours, theirs;
  StoredPixels our_layout, their_layout;
  ASSERT_EQ(stb_codec().decode(bytes, ours, our_layout), Outcome::kDone) << name;
  ASSERT_EQ(opencv_codec()->decode(bytes, theirs, their_layout), Outcome::kDone) << name;
  EXPECT_EQ(our_layout.channels, their_layout.channels) << name;
  EXPECT_EQ(our_layout.bits, their_layout.bits) << name;
  ASSERT_EQ(ours.rgba.size(), theirs.rgba.size()) << name;
  ASSERT_EQ(ours.width, theirs.width) << name;
  int farthest = 0;
  for (std::size_t i = 0; i < ours.rgba.size(); ++i)
    farthest = std::max(farthest, std::abs(int{ours.rgba[i]} - int{theirs.rgba[i]}));
  EXPECT_LE(farthest, within) << name;
}

TEST(StbCodec, ReadsWhatOpenCvReads) {
  for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
    cv::Mat picture(19, 23, type);
    cv::randu(picture, cv::Scalar::all(0), cv::Scalar::all(CV_MAT_DEPTH(type) == CV_8U ? 256 : 65536));
    expect_alike(encoded_by_opencv(".png", picture), 0, "PNG of type " + std::to_string(type));
  }
  cv::Mat bitmap(19, 23, CV_8UC3);
  cv::randu(bitmap, cv::Scalar::all(0), cv::Scalar::all(256));
  expect_alike(encoded_by_opencv(".bmp", bitmap), 0, "BMP");
  // Decoders of JPEG round, and interpolate colours, in their own ways.
  cv::Mat smooth(40, 60, CV_8UC3);
  for (int y = 0; y < smooth.rows; ++y) {
    for (int x = 0; x < smooth.cols; ++x)
      smooth.at<cv::Vec3b>(y, x) = {cv::saturate_cast<std::uint8_t>(4 * x), cv::saturate_cast<std::uint8_t>(6 * y), 90};
  }
  expect_alike(encoded_by_opencv(".jpg", smooth), 6, "JPEG");
}

TEST(StbCodec, ReadsTheSharedPictures) {
  const std::filesystem::path folder = test::assets_dir() / "images";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no pictures in " << folder;
  std::size_t read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".png") continue;
    const std::string bytes = read_file(entry.path());
    expect_alike({bytes.begin(), bytes.end()}, 0, entry.path().string());
    ++read;
  }
  EXPECT_GT(read, 0U);
}

TEST(StbCodec, PngRoundTripsAreExactInBothCodecs) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(1, 40), std::pair(67, 31)}) {
    const Image image = noisy(width, height, 3);
    const Bytes bytes = stb_codec().encode_png(image);
    Image by_stb, by_opencv;
    StoredPixels layout;
    ASSERT_EQ(stb_codec().decode(bytes, by_stb, layout), Outcome::kDone);
    ASSERT_EQ(opencv_codec()->decode(bytes, by_opencv, layout), Outcome::kDone);
    EXPECT_EQ(by_stb.rgba, image.rgba);
    EXPECT_EQ(by_opencv.rgba, image.rgba);
    EXPECT_EQ(layout.channels, 4);
    EXPECT_EQ(decode_image(bytes, "ours").rgba, image.rgba);  // its chunks and their lengths, too
  }
  const Bytes large = stb_codec().encode_png(noisy(300, 200, 4)),
              theirs = opencv_codec()->encode_png(noisy(300, 200, 4));
  EXPECT_LT(static_cast<double>(large.size()), 1.25 * static_cast<double>(theirs.size()));
}

TEST(StbCodec, KeepsSixteenBits) {
  Grey16 grey{37, 5, {}};
  for (int i = 0; i < 37 * 5; ++i) grey.values.push_back(static_cast<std::uint16_t>(i * 353));
  for (const Bytes& bytes : {stb_codec().encode_png16(grey), opencv_codec()->encode_png16(grey)}) {
    Grey16 by_stb, by_opencv;
    StoredPixels layout;
    ASSERT_EQ(stb_codec().decode_grey16(bytes, by_stb, layout), Outcome::kDone);
    ASSERT_EQ(opencv_codec()->decode_grey16(bytes, by_opencv, layout), Outcome::kDone);
    EXPECT_EQ(by_stb.values, grey.values);
    EXPECT_EQ(by_opencv.values, grey.values);
    EXPECT_EQ(decode_grey16(bytes, "depth").values, grey.values);
  }
  EXPECT_THROW(decode_grey16(stb_codec().encode_png(Image(4, 4)), "colour"), InputError);
}

TEST(StbCodec, JpegIsNearItsPicture) {
  Image image(48, 32);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      image.pixel(x, y)[0] = static_cast<std::uint8_t>(5 * x);
      image.pixel(x, y)[1] = static_cast<std::uint8_t>(7 * y);
      image.pixel(x, y)[2] = 128;
    }
  }
  Image again;
  StoredPixels layout;
  ASSERT_EQ(opencv_codec()->decode(stb_codec().encode_jpeg(image, 95), again, layout), Outcome::kDone);
  EXPECT_EQ(layout.channels, 3);
  double sum = 0.0;
  for (std::size_t i = 0; i < image.rgba.size(); ++i) sum += std::abs(int{image.rgba[i]} - int{again.rgba[i]});
  EXPECT_LT(sum / static_cast<double>(image.rgba.size()), 3.0);
}

TEST(StbCodec, RefusesDamagedFiles) {
  Image image;
  StoredPixels layout;
  EXPECT_EQ(stb_codec().decode({}, image, layout), Outcome::kDamaged);
  EXPECT_EQ(stb_codec().decode(Bytes(100, 7), image, layout), Outcome::kDamaged);
  const Bytes png = stb_codec().encode_png(noisy(64, 64, 1));
  for (std::size_t length = 0; length + 100 < png.size(); length += 97) {
    const Bytes part(png.begin(), png.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_EQ(stb_codec().decode(part, image, layout), Outcome::kDamaged) << length;
  }
  EXPECT_FALSE(stb_codec().reads("WebP"));
  EXPECT_TRUE(stb_codec().reads("PNG"));
}

}  // namespace
}  // namespace anigen::io
