#include "anigen/train/grad_clip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::train {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(AdaptiveGradClipper, ThresholdMovesOnceTheBufferIsFull) {
  AdaptiveGradClipper clipper({100.0, 50.0, 3});
  EXPECT_DOUBLE_EQ(clipper.update(1), 1);
  EXPECT_DOUBLE_EQ(clipper.update(2), 1);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 100) << "two of three norms seen";
  clipper.update(9);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 2) << "median of 1, 2, 9";
  EXPECT_DOUBLE_EQ(clipper.update(8), 2 / (8 + 1e-6)) << "clipped at the threshold before this norm";
  EXPECT_DOUBLE_EQ(clipper.threshold(), 8) << "8 replaced 1: median of 8, 2, 9";
}

TEST(AdaptiveGradClipper, MaxNormCapsTheThreshold) {
  AdaptiveGradClipper clipper({1.0, 95.0, 2});
  clipper.update(50);
  clipper.update(60);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 1);
}

TEST(AdaptiveGradClipper, WithoutMaxNormNothingIsClippedAtFirst) {
  AdaptiveGradClipper clipper({std::nullopt, 95.0, 2});
  EXPECT_DOUBLE_EQ(clipper.update(1e6), 1);
  EXPECT_EQ(clipper.threshold(), kInfinity);
}

TEST(AdaptiveGradClipper, NormsThatAreNotFiniteAreNotRecorded) {
  AdaptiveGradClipper clipper({1.0, 95.0, 4});
  EXPECT_EQ(clipper.update(kInfinity), 0);
  EXPECT_TRUE(std::isnan(clipper.update(std::nan(""))));
  EXPECT_EQ(clipper.state().length, 0u);
}

TEST(AdaptiveGradClipper, RestoredStateContinuesTheSame) {
  AdaptiveGradClipper whole({5.0, 90.0, 4}), first({5.0, 90.0, 4}), second({5.0, 90.0, 4});
  const std::vector<double> norms{1, 3, 2, 4, 0.5, 2.5, 7, 1.5};
  for (const double norm : norms) whole.update(norm);
  for (std::size_t i = 0; i < 5; ++i) first.update(norms[i]);
  second.restore(first.state());
  for (std::size_t i = 5; i < norms.size(); ++i) second.update(norms[i]);
  EXPECT_EQ(second.threshold(), whole.threshold());
  EXPECT_EQ(second.state().buffer, whole.state().buffer);
  AdaptiveGradClipper other({5.0, 90.0, 3});
  EXPECT_THROW(other.restore(first.state()), InputError);
}

}  // namespace
}  // namespace anigen::train
