#include "anigen/features/voxel_neighbours.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::features {
namespace {

using geometry::Voxel;

TEST(VoxelNeighbours, AgreeWithASearchThroughAll) {
  constexpr int kCells = 9;
  Rng rng(3, "voxels");
  std::vector<Voxel> voxels;
  for (int x = 0; x < kCells; ++x) {
    for (int y = 0; y < kCells; ++y) {
      for (int z = 0; z < kCells; ++z) {
        if (rng.chance(0.3)) voxels.push_back({x, y, z});
      }
    }
  }
  std::swap(voxels.front(), voxels.back());  // any order will do
  const VoxelNeighbours neighbours(voxels, kCells);
  for (const int radius : {0, 1, 2}) {
    for (const Voxel& voxel : voxels) {
      std::vector<std::size_t> expected;
      for (std::size_t i = 0; i < voxels.size(); ++i) {
        bool near = true;
        for (std::size_t axis = 0; axis < 3; ++axis) near = near && std::abs(voxels[i][axis] - voxel[axis]) <= radius;
        if (near) expected.push_back(i);
      }
      std::vector<std::size_t> found = neighbours.within(voxel, radius);
      std::sort(found.begin(), found.end());
      ASSERT_EQ(found, expected);
    }
  }
}

TEST(VoxelNeighbours, RefusesVoxelsOutsideOrTwice) {
  EXPECT_THROW(VoxelNeighbours({{0, 0, 4}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({{0, -1, 0}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({{1, 2, 3}, {0, 0, 0}, {1, 2, 3}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({}, 0), InputError);
}

}  // namespace
}  // namespace anigen::features
