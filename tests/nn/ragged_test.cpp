#include "anigen/nn/ragged.h"

#include <gtest/gtest.h>

namespace anigen::nn {
namespace {

TEST(Ragged, SplitGivesItemsInOrder) {
  const Ragged items({2, 0, 1});
  const std::vector<Tensor> parts = items.split(torch::arange(3));
  ASSERT_EQ(parts.size(), 3U);
  EXPECT_EQ(parts[1].numel(), 0);
  EXPECT_EQ(parts[2][0].item<int>(), 2);
  EXPECT_EQ(items.offset(2), 2);
}

TEST(Ragged, RowOffsetsEndWithTheNumberOfRows) {
  EXPECT_TRUE(torch::equal(Ragged({2, 0, 1}).row_offsets(), torch::tensor({0, 2, 2, 3}, torch::kInt64)));
  EXPECT_TRUE(torch::equal(Ragged({}).row_offsets(), torch::tensor({0}, torch::kInt64)));
}

}  // namespace
}  // namespace anigen::nn
