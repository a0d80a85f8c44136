#include "anigen/io/image_orientation.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "anigen/core/error.h"
#include "tests/support/picture_files.h"

namespace anigen::io {
namespace {

using test::FileBytes;

/// 3 × 2 pixels: 1 2 3 / 4 5 6
Image numbered() {
  Image image(3, 2);
  for (int i = 0; i < 6; ++i) image.pixel(i % 3, i / 3)[0] = static_cast<std::uint8_t>(i + 1);
  return image;
}

std::vector<int> reds(const Image& image) {
  std::vector<int> found;
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) found.push_back(image.rgba[i]);
  return found;
}

FileBytes encoded(const char* extension) {
  FileBytes bytes;
  if (!cv::imencode(extension, cv::Mat(16, 24, CV_8UC3, cv::Scalar(200, 100, 50)), bytes)) throw std::bad_alloc();
  return bytes;
}

// Where the stored row 0 and column 0 lie in the upright picture, EXIF 2.3, section 4.6.4, "Orientation".
const std::vector<std::vector<int>> kUprightPixels{{1, 2, 3, 4, 5, 6},   // top, left
                                                   {3, 2, 1, 6, 5, 4},   // top, right
                                                   {6, 5, 4, 3, 2, 1},   // bottom, right
                                                   {4, 5, 6, 1, 2, 3},   // bottom, left
                                                   {1, 4, 2, 5, 3, 6},   // left, top
                                                   {4, 1, 5, 2, 6, 3},   // right, top
                                                   {6, 3, 5, 2, 4, 1},   // right, bottom
                                                   {3, 6, 2, 5, 1, 4}};  // left, bottom

TEST(Upright, TurnsAndMirrorsEveryOrientation) {
  for (int orientation = 1; orientation <= 8; ++orientation) {
    const Image found = upright(numbered(), orientation);
    EXPECT_EQ(found.width, orientation < 5 ? 3 : 2) << orientation;
    EXPECT_EQ(found.height, orientation < 5 ? 2 : 3) << orientation;
    EXPECT_EQ(reds(found), kUprightPixels[static_cast<std::size_t>(orientation - 1)]) << orientation;
  }
  EXPECT_THROW(upright(numbered(), 0), InputError);
  EXPECT_THROW(upright(numbered(), 9), InputError);
}

TEST(Upright, TiffIsUprightOnceItIsDecoded) {
  for (int orientation = 1; orientation <= 8; ++orientation) {
    const FileBytes tiff = test::grey_tiff(3, 2, {1, 2, 3, 4, 5, 6}, orientation);
    EXPECT_EQ(reds(decode_image(tiff, "scan")), kUprightPixels[static_cast<std::size_t>(orientation - 1)]);
    EXPECT_EQ(exif_orientation(tiff), 1) << "would be turned twice";
  }
}

TEST(ExifOrientation, IsReadFromEveryFormatAndByteOrder) {
  for (int orientation = 1; orientation <= 8; ++orientation) {
    for (const bool big_endian : {false, true}) {
      const FileBytes exif = test::exif_block(orientation, big_endian);
      EXPECT_EQ(exif_orientation(test::jpeg_with_exif(encoded(".jpg"), exif)), orientation);
      EXPECT_EQ(exif_orientation(test::png_with_exif(encoded(".png"), exif)), orientation);
      FileBytes webp = encoded(".webp");
      webp.insert(webp.end(), {'E', 'X', 'I', 'F', static_cast<std::uint8_t>(exif.size()), 0, 0, 0});
      webp.insert(webp.end(), exif.begin(), exif.end());
      EXPECT_EQ(exif_orientation(webp), orientation);
    }
  }
}

TEST(ExifOrientation, IsUprightWhereNothingUsefulIsSaid) {
  for (const char* extension : {".jpg", ".png", ".webp", ".bmp", ".tif"}) {
    EXPECT_EQ(exif_orientation(encoded(extension)), 1) << extension;
  }
  EXPECT_EQ(exif_orientation({}), 1);
  for (const int nonsense : {0, 9, 65535}) {
    EXPECT_EQ(exif_orientation(test::jpeg_with_exif(encoded(".jpg"), test::exif_block(nonsense))), 1);
  }
}

TEST(ExifOrientation, DamagedBlocksAreNoError) {
  const FileBytes exif = test::exif_block(6);
  const FileBytes jpeg = test::jpeg_with_exif(encoded(".jpg"), exif);
  const FileBytes png = test::png_with_exif(encoded(".png"), exif);
  for (const FileBytes& whole : {jpeg, png}) {
    for (std::size_t length = 0; length < 80; ++length) {
      const int found = exif_orientation({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length)});
      EXPECT_TRUE(found == 1 || found == 6) << length;
    }
    for (std::size_t at = 0; at < 80; ++at) {
      FileBytes damaged = whole;
      damaged[at] = 0xFF;
      const int found = exif_orientation(damaged);
      EXPECT_TRUE(found >= 1 && found <= 8) << at;
    }
  }
}

}  // namespace
}  // namespace anigen::io
