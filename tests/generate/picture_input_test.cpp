#include "anigen/generate/picture_input.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/io/image_resize.h"
#include "tests/support/onnx_files.h"
#include "tests/support/paths.h"
#include "tests/support/picture_files.h"

namespace anigen::generate {
namespace {

using torch::Tensor;

/// Every pixel of its own colour, transparent but for the columns and rows given (both ends included).
io::Image cutout(int width, int height, int left, int top, int right, int bottom) {
  io::Image image(width, height, 0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      std::uint8_t* pixel = image.pixel(x, y);
      pixel[0] = static_cast<std::uint8_t>(10 + 9 * x);
      pixel[1] = static_cast<std::uint8_t>(250 - 11 * y);
      pixel[2] = static_cast<std::uint8_t>(5 * x + 3 * y);
      pixel[3] = x >= left && x <= right && y >= top && y <= bottom ? 255 : 0;
    }
  }
  return image;
}

/// Pixel as generation reads it: on black, rounded down.
int on_black(int color, int alpha) {
  return static_cast<int>(static_cast<float>(color) / 255.0F * (static_cast<float>(alpha) / 255.0F) * 255.0F);
}

/// The result, whose side is the crop's, holds the part of the picture that begins at (x0, y0).
void expect_part(const io::Image& found, const io::Image& picture, int x0, int y0) {
  for (int y = 0; y < found.height; ++y) {
    for (int x = 0; x < found.width; ++x) {
      const int from_x = x + x0, from_y = y + y0;
      const bool inside = from_x >= 0 && from_x < picture.width && from_y >= 0 && from_y < picture.height;
      for (int c = 0; c < 3; ++c) {
        const std::uint8_t* from = inside ? picture.pixel(from_x, from_y) : nullptr;
        EXPECT_EQ(found.pixel(x, y)[c], inside ? on_black(from[c], from[3]) : 0) << x << ", " << y << ", " << c;
      }
      EXPECT_EQ(found.pixel(x, y)[3], 255);
    }
  }
}

PreprocessingOptions sized(int size) {
  PreprocessingOptions options;
  options.size = size;
  return options;
}

InputPicture named(io::Image image) { return {std::move(image), "picture.png", false}; }

bool mentions(const std::vector<std::string>& notices, const std::string& words) {
  return std::any_of(notices.begin(), notices.end(),
                     [&](const std::string& notice) { return notice.find(words) != std::string::npos; });
}

void expect_refused(const std::function<void()>& use, const std::string& words, const std::string& file = "") {
  try {
    use();
    ADD_FAILURE() << "accepted; expected: " << words;
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    if (!file.empty()) {
      EXPECT_EQ(error.file(), file);
    }
  }
}

/// Normals that depend on the place alone; remembers what it saw.
class KnownNormals : public vision::NormalEstimator {
 public:
  Tensor normals(const Tensor& rgb) override {
    seen = rgb.clone();
    const std::int64_t height = rgb.size(2), width = rgb.size(3);
    const Tensor x = torch::linspace(-0.7, 0.7, width).view({1, 1, 1, width}).expand({1, 1, height, width});
    const Tensor y = torch::linspace(0.6, -0.6, height).view({1, 1, height, 1}).expand({1, 1, height, width});
    return torch::cat({x, y, (1 - x * x - y * y).sqrt()}, 1);
  }
  Tensor seen;
};

TEST(ImagePreprocessing, CropsToASquareOneFifthLargerThanTheObject) {
  // Columns 3 … 13, rows 5 … 8: extent 10, side int(12.0), six pixels around (8, 6.5), cut to whole ones.
  io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  picture.pixel(0, 0)[3] = 204;   // not foreground: the box does not grow
  picture.pixel(12, 11)[3] = 90;  // inside the box: shows, darkened
  const PreprocessedImage found = ImagePreprocessor(sized(12)).run(named(picture));
  expect_part(found.picture, picture, 2, 0);
  EXPECT_EQ(found.picture.pixel(10, 11)[0], on_black(118, 90));
  EXPECT_TRUE(mentions(found.notices, "own transparency"));

  picture.pixel(0, 0)[3] = 205;  // columns 0 … 13, rows 0 … 8: extent 13, side int(15.6) = 15, seven around (6.5, 4)
  EXPECT_EQ(io::inference_box(picture), (io::PixelBox{0, -3, 13, 11}));
}

TEST(ImagePreprocessing, WhatLiesOutsideThePictureIsBlack) {
  // Extent 10, side 12, six around (5, 2): columns -1 … 10, rows -4 … 7 of a picture that begins at 0.
  const io::Image picture = cutout(14, 10, 0, 0, 10, 4);
  const PreprocessedImage found = ImagePreprocessor(sized(12)).run(named(picture));
  expect_part(found.picture, picture, -1, -4);
  // Extent 9, side int(10.8) = 10, five around (4.5, 2): -0.5 is cut towards zero, so a column is lost.
  EXPECT_EQ(io::inference_box(cutout(12, 10, 0, 0, 9, 4)), (io::PixelBox{0, -3, 9, 7}));
}

TEST(ImagePreprocessing, WithoutForegroundTheWholePictureIsUsed) {
  io::Image picture = cutout(16, 16, 0, 0, 15, 15);
  for (std::size_t i = 3; i < picture.rgba.size(); i += 4) picture.rgba[i] = 204;
  expect_part(ImagePreprocessor(sized(16)).run(named(picture)).picture, picture, 0, 0);
}

TEST(ImagePreprocessing, TensorsHoldTheBytesOfThePictures) {
  const PreprocessedImage found = ImagePreprocessor(sized(30)).run(named(cutout(20, 20, 3, 5, 13, 8)));
  ASSERT_EQ(found.picture_tensor.sizes(), (std::vector<std::int64_t>{1, 3, 30, 30}));
  EXPECT_EQ(found.picture_tensor.scalar_type(), torch::kFloat32);
  for (int c = 0; c < 3; ++c)
    EXPECT_EQ(found.picture_tensor[0][c][14][11].item<float>(), found.picture.pixel(11, 14)[c] / 255.0F);
  EXPECT_EQ(found.picture.width, 30);
  EXPECT_EQ(found.normals.rgba, found.picture.rgba) << "colours stand in for normals by default";
  EXPECT_TRUE(torch::equal(found.normals_tensor, found.picture_tensor));
  EXPECT_TRUE(mentions(found.notices, "normals: none"));
}

/// Opaque grey of one level but for the columns and rows given, which are of another.
io::Image grey_mask(int width, int height, int left, int top, int right, int bottom, int outside, int inside) {
  io::Image mask(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool in = x >= left && x <= right && y >= top && y <= bottom;
      std::fill_n(mask.pixel(x, y), 3, static_cast<std::uint8_t>(in ? inside : outside));
    }
  }
  return mask;
}

TEST(ImagePreprocessing, AMaskTakesThePlaceOfTheBackgroundsRemoval) {
  // The picture's own transparency shows other columns than the mask does.
  const io::Image picture = cutout(20, 20, 12, 12, 15, 15), expected = cutout(20, 20, 3, 5, 13, 8);
  const InputPicture mask{grey_mask(20, 20, 3, 5, 13, 8, 127, 128), "mask.png", false};
  const PreprocessedImage found = ImagePreprocessor(sized(12)).run(named(picture), nullptr, &mask);
  expect_part(found.picture, expected, 2, 0);
  EXPECT_TRUE(mentions(found.notices, "removed by the mask mask.png"));
  EXPECT_EQ(picture_of(found.mask).rgba, grey_mask(20, 20, 3, 5, 13, 8, 0, 255).rgba);
  EXPECT_EQ(picture_of(ImagePreprocessor(sized(12)).run(named(expected)).mask).rgba, picture_of(found.mask).rgba);

  InputPicture brushed = mask;  // white strokes on transparent ground
  brushed.image = cutout(20, 20, 3, 5, 13, 8);
  for (std::size_t i = 0; i < brushed.image.rgba.size(); ++i) {
    if (i % 4 != 3) brushed.image.rgba[i] = 255;
  }
  EXPECT_EQ(ImagePreprocessor(sized(12)).run(named(picture), nullptr, &brushed).picture.rgba, found.picture.rgba);

  const auto refused = [&](io::Image image, const std::string& words) {
    const InputPicture other{std::move(image), "mask.png", false};
    expect_refused([&] { ImagePreprocessor(sized(12)).run(named(picture), nullptr, &other); }, words, "mask.png");
  };
  refused(grey_mask(20, 19, 3, 5, 13, 8, 0, 255), "20 x 19 pixels is not of the size of its picture, 20 x 20");
  refused(grey_mask(20, 20, 0, 0, 19, 19, 127, 127), "marks no object");
  refused(io::Image(20, 20, 0), "fully transparent");
}

TEST(ImagePreprocessing, AMaskIsAsLargeAsItsLargePicture) {
  const io::Image picture(1500, 1200);
  const InputPicture mask{grey_mask(1500, 1200, 300, 200, 899, 799, 0, 255), "mask.png", false};
  const PreprocessedImage found = ImagePreprocessor(sized(32)).run(named(picture), nullptr, &mask);
  EXPECT_EQ(found.mask.width, 1024);
  const io::Image shown = picture_of(found.mask);
  EXPECT_EQ(shown.width, 1500);
  EXPECT_EQ(shown.height, 1200);
  EXPECT_GT(shown.pixel(310, 210)[0], 250);
  EXPECT_LT(shown.pixel(290, 210)[0], 5);
}

class NetworkPreprocessing : public ::testing::Test {
 protected:
  /// Without normalisation, red is the mask.
  MattingOptions red_is_object(int side) {
    MattingOptions matting;
    matting.network = folder_ / "red.onnx";
    matting.mean = {0.0, 0.0, 0.0};
    matting.deviation = {1.0, 1.0, 1.0};
    write_file_atomically(matting.network, test::onnx_bytes(test::channel_sum_network(side, {1, 0, 0})));
    return matting;
  }
  test::TemporaryFolder folder_;
};

TEST_F(NetworkPreprocessing, ACutoutIsMultipliedByItsMaskTwice) {
  io::Image picture(20, 20, 0x00C864FFu);
  for (int y = 5; y <= 8; ++y) {
    for (int x = 3; x <= 13; ++x) picture.pixel(x, y)[0] = 255;
  }
  picture.pixel(6, 3)[0] = 130;  // half in the mask
  PreprocessingOptions options = sized(12);
  options.matting = red_is_object(20);
  const std::vector<std::uint8_t> mask = MattingNetwork(options.matting).mask(picture);
  ASSERT_NEAR(mask[3 * 20 + 6], 130, 1);
  ASSERT_EQ(mask[0], 0);

  const PreprocessedImage found = ImagePreprocessor(options).run(named(picture));
  EXPECT_TRUE(mentions(found.notices, "red.onnx"));
  io::Image cut = picture;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) cut.rgba[4 * i + c] = byte_product(cut.rgba[4 * i + c], mask[i]);
    cut.rgba[4 * i + 3] = mask[i];
  }
  expect_part(found.picture, cut, 2, 0);
  const int once = found.picture.pixel(6 - 2, 3)[1];
  EXPECT_NEAR(once, 200.0 * 130 * 130 / 255 / 255, 2.0) << "darkened by the square of the mask";
}

TEST_F(NetworkPreprocessing, ALargePictureIsReducedBeforeItsBackgroundIsRemoved) {
  io::Image picture(2048, 1024, 0x0000FFFFu);
  for (int y = 400; y < 600; ++y) {
    for (int x = 900; x < 1300; ++x) picture.pixel(x, y)[0] = 255;
  }
  PreprocessingOptions options = sized(64);
  options.matting = red_is_object(64);
  options.normals = NormalSource::kEstimator;
  const auto estimator = std::make_shared<KnownNormals>();
  const PreprocessedImage found = ImagePreprocessor(options, estimator).run(named(picture));
  // The estimator sees the picture as it came.
  EXPECT_EQ(estimator->seen.sizes(), (std::vector<std::int64_t>{1, 3, 1024, 2048}));
  EXPECT_EQ(found.normals.width, 64);
  // 400 x 200 of 2048 pixels are half as many of 1024: the crop fits them with a margin of a fifth.
  int wide = 0;
  for (int x = 0; x < 64; ++x) wide += found.picture.pixel(x, 32)[0] > 100;
  EXPECT_NEAR(wide, 64 / 1.2, 3.0);
}

TEST_F(NetworkPreprocessing, OptionsDecideWhatIsTrusted) {
  io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  PreprocessingOptions options = sized(12);
  options.matting = red_is_object(20);
  EXPECT_TRUE(mentions(ImagePreprocessor(options).run(named(picture)).notices, "own transparency"));
  options.background = Background::kNetwork;
  const PreprocessedImage by_network = ImagePreprocessor(options).run(named(picture));
  EXPECT_TRUE(mentions(by_network.notices, "red.onnx"));
  EXPECT_TRUE(mentions(by_network.notices, "was not used"));
  options.background = Background::kAlpha;
  EXPECT_TRUE(mentions(ImagePreprocessor(options).run(named(picture)).notices, "own transparency"));
  const io::Image opaque(20, 20, 0x205080FFu);
  expect_refused([&] { ImagePreprocessor(options).run(named(opaque)); }, "no transparent pixel", "picture.png");

  options.background = Background::kKeep;
  options.size = 24;  // extent 19, side int(22.8) = 22, eleven around (9.5, 9.5): columns -1 … 19
  const PreprocessedImage kept = ImagePreprocessor(options).run(named(opaque));
  EXPECT_TRUE(mentions(kept.notices, "kept; the whole picture"));
  EXPECT_EQ(kept.picture.pixel(12, 12)[2], 0x80);
  EXPECT_EQ(kept.picture.pixel(0, 0)[2], 0) << "the margin is black";
}

TEST(Reduced, SidesAreMultipliedAndCutAsFloatingPointDoes) {
  const auto size = [](int width, int height) {
    const io::Image found = reduced(io::Image(width, height), 1024);
    return std::pair<int, int>(found.width, found.height);
  };
  EXPECT_EQ(size(1024, 700), std::make_pair(1024, 700));
  EXPECT_EQ(size(1500, 1000), std::make_pair(1024, 682));
  EXPECT_EQ(size(60, 1025), std::make_pair(59, 1024));
  EXPECT_EQ(size(1122, 11), std::make_pair(1023, 10));  // 1122 · (1024 / 1122) = 1023.99…
  EXPECT_EQ(size(5000, 3), std::make_pair(1024, 1));
}

TEST(NormalPictures, AreColouredForTheViewer) {
  // x 0.5, y -0.25, z 0.75: 255 · (0.25, 0.375, 0.875) = 63.75, 95.6, 223.1
  const Tensor normals = torch::tensor({0.5F, -0.25F, 0.75F}).view({1, 3, 1, 1}).expand({1, 3, 2, 3});
  const io::Image found = normal_picture(normals);
  ASSERT_EQ(found.width, 3);
  ASSERT_EQ(found.height, 2);
  EXPECT_EQ(std::vector<int>(found.pixel(2, 1), found.pixel(2, 1) + 4), (std::vector<int>{63, 95, 223, 255}));
  const io::Image wall = normal_picture(torch::tensor({0.0F, 0.0F, 1.0F}).view({1, 3, 1, 1}));
  EXPECT_EQ(std::vector<int>(wall.pixel(0, 0), wall.pixel(0, 0) + 3), (std::vector<int>{127, 127, 255}));
  const Tensor bad = torch::full({1, 3, 2, 2}, std::numeric_limits<float>::quiet_NaN());
  EXPECT_THROW(normal_picture(bad), InputError);
}

TEST(NormalPictures, AreEstimatedFromTheWholePictureAndCroppedLikeIt) {
  io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  PreprocessingOptions options = sized(12);
  options.normals = NormalSource::kEstimator;
  const auto estimator = std::make_shared<KnownNormals>();
  const PreprocessedImage found = ImagePreprocessor(options, estimator).run(named(picture));
  ASSERT_EQ(estimator->seen.sizes(), (std::vector<std::int64_t>{1, 3, 20, 20}));
  EXPECT_EQ(estimator->seen[0][0][19][17].item<float>(), (10 + 9 * 17) / 255.0F) << "colours under alpha 0 are seen";
  const io::Image estimate = normal_picture(estimator->normals(torch::zeros({1, 3, 20, 20})));
  expect_part(found.normals, with_alpha_of(estimate, picture), 2, 0);
  EXPECT_TRUE(mentions(found.notices, "normals: estimated"));

  options.estimator_side = 10;
  const PreprocessedImage coarse = ImagePreprocessor(options, estimator).run(named(picture));
  EXPECT_EQ(estimator->seen.sizes(), (std::vector<std::int64_t>{1, 3, 10, 10}));
  EXPECT_NEAR(coarse.normals.pixel(6, 6)[0], found.normals.pixel(6, 6)[0], 8);
}

TEST(NormalPictures, AnEstimatorsRefusalNamesThePicture) {
  class Refusing : public vision::NormalEstimator {
    Tensor normals(const Tensor&) override { throw InputError("", "image", "too large"); }
  };
  PreprocessingOptions options = sized(12);
  options.normals = NormalSource::kEstimator;
  ImagePreprocessor preprocessor(options, std::make_shared<Refusing>());
  expect_refused([&] { preprocessor.run(named(cutout(20, 20, 3, 5, 13, 8))); }, "too large", "picture.png");
}

TEST(NormalPictures, OfTheUserFollowThePicture) {
  const io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  io::Image map(20, 20, 0x7F7FFFFFu);
  for (int x = 0; x < 20; ++x) map.pixel(x, 6)[0] = static_cast<std::uint8_t>(12 * x);
  PreprocessingOptions options = sized(12);
  options.normals = NormalSource::kFile;
  ImagePreprocessor preprocessor(options);
  const InputPicture same{map, "map.png", false};
  const PreprocessedImage found = preprocessor.run(named(picture), &same);
  expect_part(found.normals, with_alpha_of(map, picture), 2, 0);
  EXPECT_TRUE(mentions(found.notices, "map.png"));

  const InputPicture larger{io::Image(60, 60, 0x7F7FFFFFu), "map.png", false};
  const PreprocessedImage resized = preprocessor.run(named(picture), &larger);
  EXPECT_EQ(resized.normals.pixel(6, 6)[2], 255);
  EXPECT_EQ(resized.normals.pixel(6, 0)[2], 0);
  const InputPicture wide{io::Image(60, 40, 0x7F7FFFFFu), "map.png", false};
  expect_refused([&] { preprocessor.run(named(picture), &wide); }, "does not fit", "map.png");
  expect_refused([&] { preprocessor.run(named(picture)); }, "needs a normal map", "picture.png");
}

TEST(NormalPictures, AreTakenWhereTheyAreSuppliedUnlessColoursAreAskedFor) {
  const io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  const InputPicture map{io::Image(20, 20, 0x7F7FFFFFu), "map.png", false};
  PreprocessingOptions options = sized(12);
  EXPECT_EQ(ImagePreprocessor(options).run(named(picture), &map).normals.pixel(6, 6)[0], 0x7F);
  EXPECT_TRUE(mentions(ImagePreprocessor(options).run(named(picture)).notices, "normals: none"));
  options.normals = NormalSource::kColors;
  const PreprocessedImage colors = ImagePreprocessor(options).run(named(picture), &map);
  EXPECT_EQ(colors.normals.rgba, colors.picture.rgba);
}

TEST(NormalPictures, WithoutWeightsFaceTheViewer) {
  PreprocessingOptions options = sized(12);
  options.normals = NormalSource::kFlat;
  const io::Image picture = cutout(20, 20, 3, 5, 13, 8);
  const PreprocessedImage found = ImagePreprocessor(options).run(named(picture));
  expect_part(found.normals, with_alpha_of(io::Image(20, 20, 0x8080FFFFu), picture), 2, 0);
}

class PictureFiles : public ::testing::Test {
 protected:
  std::filesystem::path stored(const std::string& name, const std::vector<std::uint8_t>& bytes) {
    write_file_atomically(folder_ / name, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return folder_ / name;
  }
  std::filesystem::path stored(const std::string& name, const io::Image& picture) {
    return stored(name, io::encode_png(picture));
  }
  void expect_unusable(const std::filesystem::path& path, const std::string& words) {
    ImagePreprocessor preprocessor(sized(32));
    expect_refused([&] { preprocessor.run(path); }, words, path.string());
  }
  test::TemporaryFolder folder_;
};

TEST_F(PictureFiles, ThatCannotBeUsedAreRefusedByOneClearLine) {
  expect_unusable(stored("text.png", std::vector<std::uint8_t>{'h', 'e', 'l', 'l', 'o'}),
                  "cannot be decoded as a picture");
  expect_unusable(stored("empty.png", std::vector<std::uint8_t>{}), "zero bytes");
  expect_unusable(folder_ / "missing.png", "missing.png");
  expect_unusable(stored("dot.png", io::Image(1, 1, 0x09090909U)), "1 x 1 pixels is too small");
  expect_unusable(stored("line.tif", test::grey_tiff(400, 3, std::vector<std::uint8_t>(1200, 7))),
                  "400 x 3 pixels is too small");
  expect_unusable(stored("wide.png", io::Image(20000, 10, 0x030201FFU)), "20000 x 10 pixels is too large");
  expect_unusable(stored("clear.png", io::Image(20, 20, 0x3264C800U)), "fully transparent");
  io::Image speck(20, 20, 0x3264C800U);
  speck.pixel(9, 9)[3] = 255;
  expect_unusable(stored("speck.png", speck), "single pixel");
  std::vector<std::uint8_t> huge = test::grey_tiff(16000, 16000, {1, 2, 3});
  expect_unusable(stored("huge.tif", huge), "100 million");
}

TEST_F(PictureFiles, OfPhonesAreTurnedUpright) {
  // Stored on its side: the left half red, the right half blue; held so that the stored left side is the top.
  io::Image stored_picture(64, 32, 0x0000FAFFU);
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      const std::uint8_t red[] = {250, 0, 0, 255};
      std::copy(red, red + 4, stored_picture.pixel(x, y));
    }
  }
  const std::vector<std::uint8_t> jpeg = io::encode_jpeg(stored_picture, 95);
  PreprocessingOptions options = sized(64);
  options.background = Background::kKeep;
  ImagePreprocessor preprocessor(options);
  const auto path = stored("phone.jpg", test::jpeg_with_exif(jpeg, test::exif_block(6)));
  const PreprocessedImage turned = preprocessor.run(path);
  EXPECT_TRUE(mentions(turned.notices, "upright"));
  EXPECT_GT(turned.picture.pixel(32, 16)[0], 200) << "red above";
  EXPECT_GT(turned.picture.pixel(32, 48)[2], 200) << "blue below";
  const PreprocessedImage plain = preprocessor.run(stored("plain.jpg", jpeg));
  EXPECT_FALSE(mentions(plain.notices, "upright"));
  EXPECT_GT(plain.picture.pixel(16, 32)[0], 200) << "red left";
}

TEST(ImagePreprocessingOptions, AreCheckedBeforeAnyPictureIsRead) {
  EXPECT_THROW(ImagePreprocessor(sized(0)), InputError);
  PreprocessingOptions options;
  options.background = Background::kNetwork;
  expect_refused([&] { ImagePreprocessor{options}; }, "needs a matting network");
  options.matting.network = "/nonexistent/network.onnx";
  expect_refused([&] { ImagePreprocessor{options}; }, "cannot be read", "/nonexistent/network.onnx");
  options = {};
  options.normals = NormalSource::kEstimator;
  expect_refused([&] { ImagePreprocessor{options}; }, "'estimator' needs");
}

TEST(ImagePreprocessingOptions, AreWordsOnTheCommandLine) {
  EXPECT_EQ(parse_background("auto"), Background::kAuto);
  EXPECT_EQ(parse_background("keep"), Background::kKeep);
  EXPECT_EQ(parse_background("alpha"), Background::kAlpha);
  EXPECT_EQ(parse_background("grabcut"), Background::kGrabCut);
  EXPECT_EQ(parse_background("network"), Background::kNetwork);
  EXPECT_EQ(parse_normal_source("color"), NormalSource::kColors);
  EXPECT_EQ(parse_normal_source("estimator"), NormalSource::kEstimator);
  EXPECT_EQ(parse_normal_source("file"), NormalSource::kFile);
  EXPECT_EQ(parse_normal_source("flat"), NormalSource::kFlat);
  expect_refused([] { parse_background("rembg"); }, "auto, keep, alpha, grabcut, network");
  expect_refused([] { parse_normal_source(""); }, "color, estimator, file, flat");
}

TEST(ImagePreprocessing, RealPicturesGiveACentredObject) {
  const std::filesystem::path folder = test::assets_dir() / "images";
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "no pictures in " << folder;
  }
  constexpr int kSide = 518;
  int pictures = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".png") continue;
    SCOPED_TRACE(entry.path().filename());
    ++pictures;
    ImagePreprocessor preprocessor({});
    const PreprocessedImage found = preprocessor.run(entry.path());
    ASSERT_EQ(found.picture.width, kSide);
    ASSERT_EQ(found.picture.height, kSide);
    int left = kSide, top = kSide, right = -1, bottom = -1;
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const std::uint8_t* pixel = found.picture.pixel(x, y);
        if (pixel[0] + pixel[1] + pixel[2] < 60) continue;
        left = std::min(left, x), right = std::max(right, x);
        top = std::min(top, y), bottom = std::max(bottom, y);
      }
    }
    // In the middle, and the longer side a twelfth of it away from both edges; dark parts of an object do not count.
    EXPECT_NEAR((left + right) / 2.0, kSide / 2.0, 0.05 * kSide);
    EXPECT_NEAR((top + bottom) / 2.0, kSide / 2.0, 0.05 * kSide);
    EXPECT_NEAR(std::max(right - left, bottom - top), kSide / 1.2, 0.05 * kSide);
    EXPECT_EQ(preprocessor.run(entry.path()).picture.rgba, found.picture.rgba) << "a second time";
  }
  EXPECT_GT(pictures, 0);
}

}  // namespace
}  // namespace anigen::generate
