#include "anigen/asset/skin_weights.h"

#include <gtest/gtest.h>

#include <limits>

namespace anigen {
namespace {

TEST(SkinWeights, AppendRowMergesDropsNormalisesAndSorts) {
  SkinWeights skin;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(skin.append_row({{2, 1.0f}, {5, 2.0f}, {2, 1.0f}, {7, nan}, {8, -1.0f}, {9, 0.0f}, {1, 4.0f}}));
  ASSERT_EQ(skin.row_size(0), 3u);
  EXPECT_EQ(skin.row(0)[0].joint, 1);
  EXPECT_FLOAT_EQ(skin.row(0)[0].weight, 0.5f);
  EXPECT_EQ(skin.row(0)[1].joint, 2);  // equal weights: lower joint first
  EXPECT_FLOAT_EQ(skin.row(0)[1].weight, 0.25f);
  EXPECT_FALSE(skin.append_row({{0, nan}}));
  EXPECT_EQ(skin.row_size(1), 0u);
  EXPECT_EQ(skin.rows(), 2u);
}

TEST(SkinWeights, LimitKeepsTheHeaviestAndCompleteRowsUntouched) {
  SkinWeights skin;
  skin.append_row({{0, 0.4f}, {1, 0.3f}, {2, 0.2f}, {3, 0.1f}});
  skin.append_row({{0, 0.7f}, {1, 0.3f}});
  const SkinWeights limited = limit_influences(skin, 2);
  ASSERT_EQ(limited.row_size(0), 2u);
  EXPECT_NEAR(limited.row(0)[0].weight, 0.4 / 0.7, 1e-6);
  EXPECT_EQ(limited.row(1)[0].weight, skin.row(1)[0].weight);
  EXPECT_EQ(skin.largest_row(), 4u);
}

TEST(SkinWeights, DenseAndBack) {
  const std::vector<float> dense{0.25f, 0.0f, 0.75f, 0.0f, 0.0f, 0.0f};
  const SkinWeights skin = from_dense(dense, 2, 3);
  EXPECT_EQ(to_dense(skin, 3), (std::vector<float>{0.25f, 0.0f, 0.75f, 1.0f, 0.0f, 0.0f}));  // empty row: joint 0
}

}  // namespace
}  // namespace anigen
