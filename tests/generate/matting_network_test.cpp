#include "anigen/generate/matting_network.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/io/onnx.h"
#include "tests/support/onnx_files.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

io::Image noise(int width, int height) {
  Rng rng(5, "picture");
  io::Image image(width, height);
  for (std::uint8_t& byte : image.rgba) byte = static_cast<std::uint8_t>(rng.index(200));
  return image;
}

class MattingNetworkTest : public ::testing::Test {
 protected:
  MattingOptions stored(const std::string& bytes) {
    MattingOptions options;
    options.network = folder_ / "network.onnx";
    write_file_atomically(options.network, bytes);
    return options;
  }
  MattingOptions stored(const test::OnnxFile& file) { return stored(test::onnx_bytes(file)); }
  static MattingOptions unnormalized(MattingOptions options) {
    options.mean = {0.0, 0.0, 0.0};
    options.deviation = {1.0, 1.0, 1.0};
    return options;
  }
  void expect_refused(const MattingOptions& options, const std::string& words) {
    try {
      MattingNetwork network(options);
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
      EXPECT_EQ(error.file(), options.network.string());
    }
  }
  test::TemporaryFolder folder_;
};

TEST_F(MattingNetworkTest, StretchesProbabilitiesToBytesRoundedDown) {
  // Without normalisation the mask is red / largest value: within [0, 1], so taken as it is.
  MattingNetwork network(unnormalized(stored(test::channel_sum_network(12, {1, 0, 0}))));
  const io::Image image = noise(12, 12);
  int largest = 0, least_red = 255, most_red = 0;
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
    for (std::size_t c = 0; c < 3; ++c) largest = std::max<int>(largest, image.rgba[i + c]);
    least_red = std::min<int>(least_red, image.rgba[i]);
    most_red = std::max<int>(most_red, image.rgba[i]);
  }
  ASSERT_GT(largest, most_red) << "the largest value of the picture must not be red for this test";
  const std::vector<std::uint8_t> mask = network.mask(image);
  ASSERT_EQ(mask.size(), 144u);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double exact = 255.0 * (image.rgba[4 * i] - least_red) / (most_red - least_red);
    EXPECT_LE(mask[i], exact + 1e-3) << i;  // rounded down; fp32 may fall below a whole number
    EXPECT_GT(mask[i], exact - 1.001) << i;
  }
  EXPECT_EQ(mask, network.mask(image)) << "a second call differs";
}

TEST_F(MattingNetworkTest, LogitsGoThroughASigmoidAfterImageNetNormalization) {
  const MattingOptions options = stored(test::channel_sum_network(10, {2, -1, 0.5}));
  MattingNetwork network(options);
  const io::Image image = noise(10, 10);
  double largest = 0.0;
  for (std::size_t i = 0; i < image.rgba.size(); ++i) {
    if (i % 4 != 3) largest = std::max<double>(largest, image.rgba[i]);
  }
  const double weights[3] = {2.0, -1.0, 0.5};
  std::vector<double> wanted;
  for (std::size_t i = 0; i < 100; ++i) {
    double logit = 0.0;
    for (std::size_t c = 0; c < 3; ++c)
      logit += weights[c] * (image.rgba[4 * i + c] / largest - options.mean[c]) / options.deviation[c];
    wanted.push_back(1.0 / (1.0 + std::exp(-logit)));
  }
  const auto [low, high] = std::minmax_element(wanted.begin(), wanted.end());
  const std::vector<std::uint8_t> mask = network.mask(image);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double exact = 255.0 * (wanted[i] - *low) / (*high - *low);
    EXPECT_LE(mask[i], exact + 0.01) << i;
    EXPECT_GT(mask[i], exact - 1.01) << i;
  }
}

TEST_F(MattingNetworkTest, NetworksOfHalfPrecisionRunInFullPrecision) {
  test::OnnxFile plain;
  plain.nodes = {{"Conv", {"picture", "weights"}, {"sum"}, {1, 1}}, {"Sigmoid", {"sum"}, {"mask"}, {}}};
  plain.weights = {{"weights", {1, 3, 1, 1}, {0.5F, -0.25F, 1.0F}}};
  plain.inputs = {{"picture", {1, 3, 10, 10}, {}}};
  plain.outputs = {{"mask", {1, 1, 10, 10}, {}}};
  const io::Image image = noise(10, 10);
  const std::vector<std::uint8_t> wanted = MattingNetwork(unnormalized(stored(plain))).mask(image);

  // As converters write it: casts around the half-precision middle, and nodes that stand before those they read.
  constexpr std::int64_t kFloat = 1, kHalf = 10;
  test::OnnxFile half = plain;
  half.nodes = {{"Cast", {"small mask"}, {"mask"}, {}, kFloat},
                {"Sigmoid", {"sum"}, {"small mask"}, {}},
                {"Conv", {"small picture", "weights"}, {"sum"}, {1, 1}},
                {"Cast", {"picture"}, {"small picture"}, {}, kHalf}};
  half.weights.front().half = true;
  EXPECT_TRUE(io::read_onnx_signature(stored(half).network).half);
  EXPECT_FALSE(io::read_onnx_signature(stored(plain).network).half);
  EXPECT_EQ(MattingNetwork(unnormalized(stored(half))).mask(image), wanted);

  half.inputs.front().half = half.outputs.front().half = true;  // without casts at either end
  half.nodes = {{"Sigmoid", {"sum"}, {"mask"}, {}}, {"Conv", {"picture", "weights"}, {"sum"}, {1, 1}}};
  EXPECT_EQ(MattingNetwork(unnormalized(stored(half))).mask(image), wanted);

  half.nodes = {{"Sigmoid", {"sum"}, {"mask"}, {}}, {"Add", {"mask", "picture"}, {"sum"}, {}}};
  expect_refused(stored(half), "wait for each other");
}

TEST_F(MattingNetworkTest, TheMaskReturnsToThePicturesSize) {
  // The left half is white, the right one black; 64 × 40 pixels are seen as 16 × 16.
  io::Image image(64, 40, 0x000000FFu);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 32; ++x) std::fill_n(image.pixel(x, y), 3, std::uint8_t{255});
  }
  for (const std::int64_t side : {16, 0}) {
    MattingOptions options = unnormalized(stored(test::channel_sum_network(side, {0, 1, 0})));
    options.size = 16;
    const std::vector<std::uint8_t> mask = MattingNetwork(options).mask(image);
    ASSERT_EQ(mask.size(), 64u * 40u);
    for (const int y : {0, 20, 39}) {
      const std::uint8_t* row = mask.data() + 64 * y;
      for (int x = 0; x < 27; ++x) EXPECT_GT(row[x], 225) << x;
      for (int x = 37; x < 64; ++x) EXPECT_LT(row[x], 30) << x;
    }
  }
}

TEST_F(MattingNetworkTest, TheFirstListedOutputIsTheMask) {
  test::OnnxFile file = test::channel_sum_network(8, {1, 0, 0});
  file.nodes.push_back({"Conv", {"picture", "blue"}, {"other"}, {1, 1}});
  file.weights.push_back({"blue", {1, 3, 1, 1}, {0, 0, 1}});
  file.outputs = {{"other", {1, 1, 8, 8}, {}}, {"mask", {1, 1, 8, 8}, {}}};
  io::Image image(8, 8, 0x000000FFu);
  image.pixel(2, 3)[2] = 255;  // blue
  image.pixel(5, 5)[0] = 255;  // red
  std::vector<std::uint8_t> mask = MattingNetwork(unnormalized(stored(file))).mask(image);
  EXPECT_EQ(mask[3 * 8 + 2], 255);
  EXPECT_EQ(mask[5 * 8 + 5], 0);
  std::swap(file.outputs[0], file.outputs[1]);
  mask = MattingNetwork(unnormalized(stored(file))).mask(image);
  EXPECT_EQ(mask[3 * 8 + 2], 0);
  EXPECT_EQ(mask[5 * 8 + 5], 255);
}

TEST_F(MattingNetworkTest, RefusesWhatIsNoMattingNetwork) {
  expect_refused(stored("these are words, not a network"), "not an ONNX network");
  expect_refused(stored(""), "not an ONNX network");
  MattingOptions missing;
  missing.network = folder_ / "missing.onnx";
  expect_refused(missing, "cannot be read");
  missing.network = folder_.path();
  expect_refused(missing, "cannot be read");

  test::OnnxFile file = test::channel_sum_network(8, {1, 0, 0});
  file.inputs.push_back({"prompt", {1, 2}, {}});
  expect_refused(stored(file), "2 inputs");
  file = test::channel_sum_network(8, {1, 0, 0});
  file.inputs.front().shape = {1, 8, 8, 3};
  expect_refused(stored(file), "[1, 3, H, W]");
  file = test::channel_sum_network(40000, {1, 0, 0});
  expect_refused(stored(file), "40000");
  file = test::channel_sum_network(8, {1, 0, 0});
  file.nodes.front().type = "NoSuchOperator";
  expect_refused(stored(file), "OpenCV");
  file = test::channel_sum_network(8, {1, 0, 0});
  file.nodes.front().inputs[1] = "missing";  // OpenCV 4.6 crashes
  expect_refused(stored(file), "OpenCV");

  MattingOptions options = stored(test::channel_sum_network(8, {1, 0, 0}));
  options.deviation[1] = 0.0;
  EXPECT_THROW(MattingNetwork{options}, InputError);
}

TEST_F(MattingNetworkTest, RefusesOutputsThatAreNoMask) {
  test::OnnxFile file = test::channel_sum_network(8, {1, 0, 0});
  file.weights.front() = {"weights", {2, 3, 1, 1}, {1, 0, 0, 0, 1, 0}};
  file.outputs.front().shape = {1, 2, 8, 8};
  MattingNetwork two_planes(stored(file));
  EXPECT_THROW(two_planes.mask(noise(8, 8)), InputError);

  MattingNetwork red(stored(test::channel_sum_network(8, {1, 0, 0})));
  try {
    red.mask(io::Image(8, 8, 0x50FF20FFu));
    ADD_FAILURE() << "a mask of a picture in which all is alike";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("no object"), std::string::npos) << error.what();
  }
}

TEST_F(MattingNetworkTest, WeightsListedAmongTheInputsAreNotPictures) {
  test::OnnxFile file = test::channel_sum_network(8, {1, 0, 0});
  file.inputs.insert(file.inputs.begin(), {"weights", {1, 3, 1, 1}, {}});
  MattingNetwork network(unnormalized(stored(file)));
  EXPECT_EQ(network.mask(noise(8, 8)).size(), 64u);
}

}  // namespace
}  // namespace anigen::generate
