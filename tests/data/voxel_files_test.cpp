#include "anigen/data/voxel_files.h"

#include <gtest/gtest.h>
#include <cmath>
#include <set>

namespace anigen::data {

namespace {

// A floor of 8 × 8 voxels at z = 3 of a grid of 32, whose surface runs a quarter of an edge of the fine grid above the
// centres. The fourth channel is the place in the list.
VoxelRows floor_rows() {
  VoxelRows rows;
  rows.channels = 4;
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      rows.coords.push_back({x, y, 3});
      rows.feats.insert(rows.feats.end(), {0.0F, 0.0F, 0.25F, static_cast<float>(rows.coords.size() - 1)});
    }
  }
  return rows;
}

TEST(SupportNoise, AddsVoxelsBesideTheSurfaceWithTheWayFromTheirOwnCentre) {
  const VoxelRows rows = floor_rows();
  Rng rng(1, "noise");
  std::size_t added = 0, least = 1000, most = 0;
  for (int repeat = 0; repeat < 50; ++repeat) {
    const VoxelRows noisy = with_support_noise(rows, 32, {0.5, 0.0}, 3, rng);
    ASSERT_EQ(noisy.feats.size(), noisy.coords.size() * noisy.channels);
    ASSERT_EQ(std::set<geometry::Voxel>(noisy.coords.begin(), noisy.coords.end()).size(), noisy.coords.size());
    for (std::size_t i = 0; i < noisy.coords.size(); ++i) {
      const float* feature = noisy.feats.data() + 4 * i;
      const geometry::Voxel& source = rows.coords[static_cast<std::size_t>(feature[3])];
      const float way[] = {0.0F, 0.0F, 0.25F};
      int apart = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        // An edge of the grid of 32 is two of the stored grid.
        EXPECT_FLOAT_EQ(feature[axis], way[axis] - 2.0F * static_cast<float>(noisy.coords[i][axis] - source[axis]));
        apart += std::abs(noisy.coords[i][axis] - source[axis]);
        EXPECT_GE(noisy.coords[i][axis], 0);
      }
      EXPECT_EQ(apart, i < rows.coords.size() ? 0 : 1);
    }
    const std::size_t more = noisy.coords.size() - rows.coords.size();
    added += more;
    least = std::min(least, more);
    most = std::max(most, more);
  }
  // 144 places lie beside the floor inside the grid; a quarter of them on average, more or less of them by the draw.
  EXPECT_NEAR(static_cast<double>(added) / 50 / 144, 0.25, 0.08);
  EXPECT_LT(least, 20U);
  EXPECT_GT(most, 50U);
}

TEST(SupportNoise, LeavesVoxelsOutButNeverAll) {
  const VoxelRows rows = floor_rows();
  Rng rng(2, "noise");
  double left = 0.0;
  for (int repeat = 0; repeat < 50; ++repeat)
    left += static_cast<double>(with_support_noise(rows, 32, {0.0, 0.2}, 3, rng).coords.size());
  EXPECT_NEAR(left / 50 / 64, 0.9, 0.03);
  VoxelRows one;
  one.channels = 0;
  one.coords = {{5, 5, 5}};
  for (int repeat = 0; repeat < 50; ++repeat)
    EXPECT_EQ(with_support_noise(one, 32, {0.0, 0.99}, 0, rng).coords.size(), 1U);
}

TEST(SupportNoise, OfOtherModelsFeaturesAreThoseOfTheNeighbour) {
  VoxelRows rows;
  rows.channels = 3;
  rows.coords = {{31, 31, 31}};
  rows.feats = {1.0F, 2.0F, 3.0F};
  Rng rng(3, "noise");
  for (int repeat = 0; repeat < 20; ++repeat) {
    const VoxelRows noisy = with_support_noise(rows, 32, {1.0, 0.0}, 0, rng);
    EXPECT_LE(noisy.coords.size(), 4U);  // three neighbours are outside the grid
    for (std::size_t i = 0; i < noisy.coords.size(); ++i) EXPECT_FLOAT_EQ(noisy.feats[3 * i + 1], 2.0F);
  }
}

}  // namespace

}  // namespace anigen::data
