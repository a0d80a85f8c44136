#include <gtest/gtest.h>

#include "anigen/core/numeric.h"

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

namespace {

TEST(ShortId, KeepsNamesAndShortensHashes) {
  EXPECT_EQ(short_id("post0"), "post0");
  EXPECT_EQ(short_id("028b880bf2df64237748d1173d6df1eaa1b23b3c01d35e936c3b76cf032cb35b"), "028b880b");
  EXPECT_EQ(short_id(""), "");
}

}  // namespace

}  // namespace anigen
