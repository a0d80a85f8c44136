#include "anigen/core/percentile.h"

#include <gtest/gtest.h>

namespace anigen {
namespace {

// numpy.percentile([1, 2, 3, 4, 10], p), worked out by hand: position p/100 · 4.
TEST(Percentile, InterpolatesLinearly) {
  const std::vector<float> values{10, 3, 1, 4, 2};
  EXPECT_DOUBLE_EQ(percentile(values, 0), 1);
  EXPECT_DOUBLE_EQ(percentile(values, 50), 3);
  EXPECT_DOUBLE_EQ(percentile(values, 95), 4 + 0.8 * 6);
  EXPECT_DOUBLE_EQ(percentile(values, 100), 10);
  EXPECT_DOUBLE_EQ(percentile({7}, 95), 7);
}

}  // namespace
}  // namespace anigen
