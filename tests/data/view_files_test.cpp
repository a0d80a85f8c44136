// Pieces of reading a published dataset that do not need one on disk.
#include <gtest/gtest.h>

#include <vector>

#include "anigen/data/view_files.h"

namespace anigen::data {
namespace {

TEST(SkinRows, ZeroRowsGoToJointZeroAndRowsSumToOne) {
  std::vector<float> skin{0, 0, 0, 0, 2, 6, 0.5f, 0.25f, 0.25f};
  EXPECT_EQ(normalize_skin_rows(skin, 3), 1u) << "rows without weight";
  EXPECT_EQ(skin, (std::vector<float>{1, 0, 0, 0, 0.25f, 0.75f, 0.5f, 0.25f, 0.25f}));
}

TEST(SkinRows, FlowAddsSubtreesOfTheFirstRoot) {
  // 1 is the root; 0 and 2 hang from it, 3 from 2; 4 is a second root with 5 below it, which stay alone.
  const std::vector<int> parents{1, -1, 1, 2, -1, 4};
  std::vector<float> skin{0.125f, 0.125f, 0.25f, 0.25f, 0.0625f, 0.125f};
  accumulate_skin_as_flow(skin, parents);
  EXPECT_EQ(skin, (std::vector<float>{0.125f, 0.75f, 0.5f, 0.25f, 0.0625f, 0.125f}));
  std::vector<float> heavy{0.75f, 0.75f};
  accumulate_skin_as_flow(heavy, {-1, 0});
  EXPECT_EQ(heavy, (std::vector<float>{1.0f, 0.75f})) << "clipped";
}

}  // namespace
}  // namespace anigen::data
