#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/image.h"
#include "tests/io/file_fuzz.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"
#include "tests/support/picture_files.h"

// Kinds of picture files that people have and OpenCV does not write.

namespace anigen::io {

namespace {

using Bytes = std::vector<std::uint8_t>;

// Pictures of every kind are made with OpenCV directly, in its BGR order.
Bytes encoded(const char* extension, const cv::Mat& picture) {
  Bytes bytes;
  if (!cv::imencode(extension, picture, bytes)) throw std::runtime_error("OpenCV cannot encode the test picture");
  return bytes;
}

Image gradient(int width, int height) {
  Image image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int rgba[4] = {x * 13 % 256, y * 7 % 256, (x + y) % 256, (x * y) % 256};
      for (int c = 0; c < 4; ++c) image.pixel(x, y)[c] = static_cast<std::uint8_t>(rgba[c]);
    }
  }
  return image;
}

void set_big_endian(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (int i = 0; i < 4; ++i)
    bytes[at + static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

TEST(Image, FillIsRgbaFromTheMostSignificantByte) {
  const Image image(3, 2, 0x11223344u);
  ASSERT_EQ(image.rgba.size(), 24u);
  EXPECT_EQ(Bytes(image.pixel(2, 1), image.pixel(2, 1) + 4), (Bytes{0x11, 0x22, 0x33, 0x44}));
}

TEST(Image, PngRoundTripIsExact) {
  const Image image = gradient(37, 21);
  const Image again = decode_image(encode_png(image), "memory");
  EXPECT_EQ(again.width, 37);
  EXPECT_EQ(again.height, 21);
  EXPECT_EQ(again.rgba, image.rgba);  // transparent pixels keep their colour, too
}

TEST(Image, FileRoundTrip) {
  const test::TemporaryFolder folder;
  write_png(folder / "deep" / "picture.png", gradient(5, 4));
  EXPECT_EQ(read_image(folder / "deep" / "picture.png").rgba, gradient(5, 4).rgba);
}

TEST(Image, ReadsGreyColourAndSixteenBits) {
  const Image grey = decode_image(encoded(".png", cv::Mat(2, 3, CV_8UC1, cv::Scalar(77))), "grey");
  EXPECT_EQ(Bytes(grey.pixel(1, 1), grey.pixel(1, 1) + 4), (Bytes{77, 77, 77, 255}));
  const Image colour = decode_image(encoded(".png", cv::Mat(2, 3, CV_8UC3, cv::Scalar(1, 2, 3))), "colour");
  EXPECT_EQ(Bytes(colour.pixel(0, 0), colour.pixel(0, 0) + 4), (Bytes{3, 2, 1, 255}));
  const Image deep = decode_image(encoded(".png", cv::Mat(2, 3, CV_16UC4, cv::Scalar(0, 257, 65535, 32768))), "deep");
  EXPECT_EQ(Bytes(deep.pixel(0, 0), deep.pixel(0, 0) + 4), (Bytes{255, 1, 0, 128}));
  const Image bitmap = decode_image(encoded(".bmp", cv::Mat(2, 3, CV_8UC3, cv::Scalar(1, 2, 3))), "bitmap");
  EXPECT_EQ(bitmap.pixel(2, 1)[0], 3);
}

TEST(Image, ReadsJpeg) {
  const Image image = decode_image(encoded(".jpg", cv::Mat(16, 24, CV_8UC3, cv::Scalar(200, 100, 50))), "photo");
  EXPECT_EQ(image.width, 24);
  EXPECT_EQ(image.height, 16);
  const int expected[4] = {50, 100, 200, 255};
  for (int c = 0; c < 4; ++c) EXPECT_NEAR(image.pixel(11, 7)[c], expected[c], 3) << "channel " << c;  // lossy
}

TEST(Image, ReadsTheSharedPictures) {
  const std::filesystem::path folder = test::assets_dir() / "images";
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "no pictures in " << folder;
  }
  std::size_t read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".png") continue;
    const Image image = read_image(entry.path());
    EXPECT_EQ(image.rgba.size(), 4u * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height));
    ++read;
  }
  EXPECT_GT(read, 0u);
}

TEST(Image, RefusesWhatIsNoPicture) {
  EXPECT_THROW(decode_image({}, "empty"), InputError);
  EXPECT_THROW(decode_image({'h', 'e', 'l', 'l', 'o'}, "text"), InputError);
  EXPECT_THROW(decode_image(Bytes(1000, 0), "zeros"), InputError);
  EXPECT_THROW(read_image("/nonexistent/picture.png"), InputError);
  try {
    decode_image({1, 2, 3}, "wing.png");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "wing.png");
  }
}

TEST(Image, RefusesFormatsWhoseSizesNobodyChecks) {
  for (const char* extension : {".ppm", ".sr", ".hdr"}) {
    const cv::Mat picture = extension == std::string(".hdr") ? cv::Mat(2, 3, CV_32FC3, cv::Scalar(1, 2, 3))
                                                             : cv::Mat(2, 3, CV_8UC3, cv::Scalar(1, 2, 3));
    EXPECT_THROW(decode_image(encoded(extension, picture), std::string("picture") + extension), InputError)
        << extension;
  }
}

TEST(Image, RefusesHostileSizesBeforeDecoding) {
  Bytes png = encode_png(gradient(4, 4));
  set_big_endian(png, 16, 16385);
  EXPECT_THROW(decode_image(png, "wide"), InputError);
  set_big_endian(png, 16, 0x7FFFFFFF);
  set_big_endian(png, 20, 0x7FFFFFFF);
  EXPECT_THROW(decode_image(png, "huge"), InputError);
  set_big_endian(png, 16, 0);
  EXPECT_THROW(decode_image(png, "nothing"), InputError);
}

TEST(Image, TruncatedFilesAreRefused) {
  const Bytes png = encode_png(gradient(64, 64));
  const Bytes jpeg = encoded(".jpg", cv::Mat(64, 64, CV_8UC3, cv::Scalar(200, 100, 50)));
  for (const Bytes& bytes : {png, jpeg}) {
    for (std::size_t length = 0; length < bytes.size(); length += 37) {
      EXPECT_THROW(decode_image(Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length)), "part"),
                   InputError)
          << length << " of " << bytes.size() << " bytes";
    }
  }
}

TEST(Image, DamagedFilesGiveErrorsOnly) {
  const test::TemporaryFolder folder;
  const Bytes jpeg = encoded(".jpg", cv::Mat(24, 24, CV_8UC3, cv::Scalar(200, 100, 50)));
  const Bytes png = encode_png(gradient(24, 24)),
              webp = encoded(".webp", cv::Mat(24, 24, CV_8UC3, cv::Scalar(9, 8, 7)));
  const Bytes bitmap = encoded(".bmp", cv::Mat(8, 8, CV_8UC3, cv::Scalar(1, 2, 3)));
  for (const Bytes& bytes : {png, jpeg, webp, bitmap}) {
    test::expect_errors_only(
        {bytes.begin(), bytes.end()}, folder / "damaged", [](const auto& path) { read_image(path); }, 150);
  }
}

TEST(Image, RefusesToEncodeAnInconsistentPicture) {
  Image image(2, 2);
  image.rgba.pop_back();
  EXPECT_THROW(encode_png(image), InputError);
  EXPECT_THROW(encode_png(Image()), InputError);
  EXPECT_THROW(Image(-1, 2), InputError);
}

TEST(Image, JpegIsSmallAndHasTransparentPixelsOverWhite) {
  Image image(32, 16, 0xFFFF0000u);  // bytes R, G, B, A from the lowest
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      std::uint8_t* pixel = image.pixel(x, y);
      pixel[0] = 200, pixel[1] = 0, pixel[2] = 0, pixel[3] = x < 16 ? 255 : 0;
    }
  }
  const Image read = decode_image(encode_jpeg(image, 90), "test");
  ASSERT_EQ(read.width, 32);
  EXPECT_NEAR(read.pixel(4, 8)[0], 200, 6);
  EXPECT_NEAR(read.pixel(4, 8)[1], 0, 6);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(read.pixel(28, 8)[c], 255, 6);
  EXPECT_THROW(encode_jpeg(Image(), 90), InputError);
}

}  // namespace

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

FileBytes encoded_pixels(const char* extension) {
  FileBytes bytes;
  if (!cv::imencode(extension, cv::Mat(16, 24, CV_8UC3, cv::Scalar(200, 100, 50)), bytes)) throw std::bad_alloc();
  return bytes;
}

// Position of the stored row 0 and column 0 in the upright image, EXIF 2.3, section 4.6.4, "Orientation".
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
      EXPECT_EQ(exif_orientation(test::jpeg_with_exif(encoded_pixels(".jpg"), exif)), orientation);
      EXPECT_EQ(exif_orientation(test::png_with_exif(encoded_pixels(".png"), exif)), orientation);
      FileBytes webp = encoded_pixels(".webp");
      webp.insert(webp.end(), {'E', 'X', 'I', 'F', static_cast<std::uint8_t>(exif.size()), 0, 0, 0});
      webp.insert(webp.end(), exif.begin(), exif.end());
      EXPECT_EQ(exif_orientation(webp), orientation);
    }
  }
}

TEST(ExifOrientation, IsUprightWhereNothingUsefulIsSaid) {
  for (const char* extension : {".jpg", ".png", ".webp", ".bmp", ".tif"})
    EXPECT_EQ(exif_orientation(encoded_pixels(extension)), 1) << extension;
  EXPECT_EQ(exif_orientation({}), 1);
  for (const int nonsense : {0, 9, 65535})
    EXPECT_EQ(exif_orientation(test::jpeg_with_exif(encoded_pixels(".jpg"), test::exif_block(nonsense))), 1);
}

TEST(ExifOrientation, DamagedBlocksAreNoError) {
  const FileBytes exif = test::exif_block(6);
  const FileBytes jpeg = test::jpeg_with_exif(encoded_pixels(".jpg"), exif);
  const FileBytes png = test::png_with_exif(encoded_pixels(".png"), exif);
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
