#include "anigen/nn/ragged.h"

#include <gtest/gtest.h>

namespace anigen::nn {
namespace {

TEST(Ragged, PadAndUnpadAreInverse) {
  const Ragged items({3, 1, 4});
  const Tensor rows = torch::arange(8 * 2, torch::kFloat32).view({8, 2});
  const Tensor padded = items.pad(rows);
  ASSERT_EQ(padded.sizes(), (std::vector<std::int64_t>{3, 4, 2}));
  EXPECT_TRUE(torch::equal(padded[1][0], rows[3]));
  EXPECT_TRUE(torch::equal(items.unpad(padded), rows));
}

TEST(Ragged, MaskHidesPaddingOnly) {
  const Ragged items({3, 1});
  const Tensor mask = items.key_mask(torch::TensorOptions().dtype(torch::kFloat32));
  ASSERT_EQ(mask.sizes(), (std::vector<std::int64_t>{2, 1, 1, 3}));
  EXPECT_TRUE(torch::equal(mask.flatten() == 0, torch::tensor({true, true, true, true, false, false})));
  EXPECT_FALSE(Ragged({2, 2}).key_mask(torch::kFloat32).defined());
}

TEST(Ragged, SplitGivesItemsInOrder) {
  const Ragged items({2, 0, 1});
  const std::vector<Tensor> parts = items.split(torch::arange(3));
  ASSERT_EQ(parts.size(), 3U);
  EXPECT_EQ(parts[1].numel(), 0);
  EXPECT_EQ(parts[2][0].item<int>(), 2);
  EXPECT_EQ(items.offset(2), 2);
}

TEST(Ragged, PaddingDoesNotPayForOneHugeItemAmongSmallOnes) {
  EXPECT_TRUE(Ragged({20, 25, 30, 22}).padding_pays());
  EXPECT_FALSE(Ragged({2000, 20, 20, 20}).padding_pays());
  EXPECT_FALSE(Ragged({3, 0}).padding_pays());
}

TEST(Ragged, CopiesPadAsWell) {
  Ragged copy({1});
  {
    const Ragged items({2, 1});
    copy = items;
  }
  const Tensor rows = torch::arange(3, torch::kFloat32).view({3, 1});
  EXPECT_TRUE(torch::equal(copy.unpad(copy.pad(rows)), rows));
}

TEST(Ragged, ManyItemsOfVeryDifferentLengthCostNothingUntilPadded) {
  std::vector<std::int64_t> lengths(200000, 1);
  lengths[0] = 1000000;  // a padded table would have 2 · 10¹¹ entries
  EXPECT_EQ(Ragged(lengths).rows(), 1199999);
}

}  // namespace
}  // namespace anigen::nn
