#include "anigen/pipeline/perceptual_metric.h"

#include <gtest/gtest.h>

#include <thread>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/io/safetensors.h"
#include "tests/models/lpips_formula.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
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

class PerceptualMetricTest : public ::testing::Test {
 protected:
  PerceptualMetricTest() {
    io::write_safetensors(trunk_, test::formula_trunk());
    io::write_safetensors(heads_, test::formula_heads());
  }
  test::TemporaryFolder folder_;
  const std::filesystem::path trunk_ = folder_ / "vgg16.safetensors", heads_ = folder_ / "heads.safetensors";
};

TEST_F(PerceptualMetricTest, MeasuresPicturesFromSeveralThreads) {
  PerceptualMetric metric({trunk_, heads_});
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

TEST_F(PerceptualMetricTest, IsDescribedByTheFilesItCameFrom) {
  const PerceptualMetric metric({trunk_, heads_});
  const Json& hashes = metric.describe().at("weights_sha256");
  ASSERT_EQ(hashes.size(), 2u);
  EXPECT_EQ(hashes[0], sha256(read_file(trunk_)));
  EXPECT_EQ(hashes[1], sha256(read_file(heads_)));
}

TEST_F(PerceptualMetricTest, RefusesWhatIsNotThere) {
  EXPECT_THROW(PerceptualMetric({trunk_}), InputError);
  EXPECT_THROW(PerceptualMetric({trunk_, heads_, folder_ / "absent.pth"}), InputError);
  EXPECT_THROW(PerceptualMetric({trunk_, heads_}, "tpu"), InputError);
  PerceptualMetric metric({trunk_, heads_});
  EXPECT_THROW(metric.distance(stripes(4), io::Image(32, 32)), InputError);
  EXPECT_THROW(metric.distance(io::Image(8, 8), io::Image(8, 8)), InputError);
}

}  // namespace
}  // namespace anigen::pipeline
