#include "anigen/generate/picture_distances.h"

#include <gtest/gtest.h>

#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/creatures/body.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/render/picture.h"
#include "tests/support/paths.h"
#include "tests/vision/lpips_formula.h"

namespace anigen::generate {
namespace {

/// Stripes over black; the alpha channel varies and must not matter.
io::Image stripes(int period, std::uint8_t alpha = 255) {
  io::Image image(32, 24, 0xFF000000u);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      image.pixel(x, y)[0] = x / period % 2 == 0 ? 250 : 20;
      image.pixel(x, y)[1] = static_cast<std::uint8_t>(8 * y);
      image.pixel(x, y)[3] = alpha;
    }
  }
  return image;
}

class LpipsDistanceTest : public ::testing::Test {
 protected:
  LpipsDistanceTest() {
    io::write_safetensors(trunk_, test::formula_trunk());
    io::write_safetensors(heads_, test::formula_heads());
  }
  test::TemporaryFolder folder_;
  const std::filesystem::path trunk_ = folder_ / "vgg16.safetensors", heads_ = folder_ / "heads.safetensors";
};

TEST_F(LpipsDistanceTest, MeasuresPicturesFromSeveralThreads) {
  LpipsDistance metric({trunk_, heads_});
  EXPECT_EQ(metric.distance(stripes(4), stripes(4, 17)), 0.0);
  const double near = metric.distance(stripes(4), stripes(5)), far = metric.distance(stripes(4), stripes(16));
  EXPECT_GT(near, 0.0);
  EXPECT_GT(far, near);
  EXPECT_EQ(metric.distance(stripes(5), stripes(4)), near);

  std::vector<double> values(4);
  std::vector<std::thread> threads;
  for (double& value : values) threads.emplace_back([&] { value = metric.distance(stripes(4), stripes(5)); });
  for (std::thread& thread : threads) thread.join();
  for (const double value : values) EXPECT_NEAR(value, near, 1e-6 * near);
}

TEST_F(LpipsDistanceTest, IsDescribedByTheFilesItCameFrom) {
  const LpipsDistance metric({trunk_, heads_});
  const Json& hashes = metric.describe().at("weights_sha256");
  ASSERT_EQ(hashes.size(), 2u);
  EXPECT_EQ(hashes[0], sha256(read_file(trunk_)));
  EXPECT_EQ(hashes[1], sha256(read_file(heads_)));
}

TEST_F(LpipsDistanceTest, RefusesWhatIsNotThere) {
  EXPECT_THROW(LpipsDistance({trunk_}), InputError);
  EXPECT_THROW(LpipsDistance({trunk_, heads_, folder_ / "absent.pth"}), InputError);
  EXPECT_THROW(LpipsDistance({trunk_, heads_}, "tpu"), InputError);
  LpipsDistance metric({trunk_, heads_});
  EXPECT_THROW(metric.distance(stripes(4), io::Image(32, 32)), InputError);
  EXPECT_THROW(metric.distance(io::Image(8, 8), io::Image(8, 8)), InputError);
}

class EncoderDistanceTest : public ::testing::Test {
 protected:
  /// A creature from `yaw` degrees.
  static io::Image picture(const char* family, double yaw) {
    render::PictureOptions options;
    options.width = options.height = 256;
    options.view.yaw_degrees = yaw;
    return render::render(creatures::make_creature(family, /*seed=*/11, 1), options);
  }

  const std::filesystem::path weights_ = test::source_dir() / "weights/anigen-small";
};

TEST_F(EncoderDistanceTest, GrowsWithThatWhichPicturesShow) {
  EncoderDistance encoder(weights_ / "ss_flow");
  const io::Image biped = picture("biped", 30);
  io::Image transparent = biped;
  for (std::size_t i = 3; i < transparent.rgba.size(); i += 4) transparent.rgba[i] = 9;
  EXPECT_NEAR(encoder.distance(biped, transparent), 0.0, 1e-6) << "alpha does not count";
  const double turned = encoder.distance(biped, picture("biped", 35)),
               other = encoder.distance(biped, picture("quadruped", 30));
  EXPECT_GT(turned, 1e-3);
  EXPECT_GT(other, 1.5 * turned);
  EXPECT_LE(other, 2.0);
  EXPECT_NEAR(encoder.distance(picture("quadruped", 30), biped), other, 1e-6);
}

TEST_F(EncoderDistanceTest, IsDescribedByConfigAndWeights) {
  const Json description = EncoderDistance(weights_ / "ss_flow").describe();
  EXPECT_EQ(description.at("config_sha256"), sha256_of_file(weights_ / "ss_flow/config.json"));
  EXPECT_EQ(description.at("weights_sha256").get<std::string>().size(), 64u);
  EXPECT_EQ(description.at("estimator_sha256").get<std::string>().size(), 64u);
  EXPECT_EQ(EncoderDistance(weights_ / "slat_flow").describe().at("flow"), description) << "which its encoder asks";
}

TEST_F(EncoderDistanceTest, RefusesFlowsWithoutColoursAndPicturesThatDiffer) {
  EXPECT_THROW(EncoderDistance(weights_ / "rig/ss_flow"), InputError);
  EXPECT_THROW(EncoderDistance(weights_ / "slat_dae"), InputError);
  EXPECT_THROW(EncoderDistance(weights_ / "absent"), InputError);
  EXPECT_THROW(EncoderDistance(weights_ / "ss_flow", "tpu"), InputError);
  EncoderDistance encoder(weights_ / "ss_flow");
  EXPECT_THROW(encoder.distance(io::Image(8, 8), io::Image(9, 8)), InputError);
  EXPECT_THROW(encoder.distance(io::Image(), io::Image()), InputError);
}

}  // namespace
}  // namespace anigen::generate
