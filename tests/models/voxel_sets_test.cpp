#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/models/voxel_components.h"
#include "anigen/models/voxel_inside.h"

namespace anigen::models {
namespace {

using torch::Tensor;

Tensor empty_grid(std::int64_t size) { return torch::zeros({size, size, size}, torch::kBool); }

// The six faces of a box of voxels.
Tensor hollow_box(std::int64_t size, std::int64_t low, std::int64_t high) {
  Tensor grid = empty_grid(size);
  grid.slice(0, low, high).slice(1, low, high).slice(2, low, high).fill_(true);
  grid.slice(0, low + 1, high - 1).slice(1, low + 1, high - 1).slice(2, low + 1, high - 1).fill_(false);
  return grid;
}

// Every voxel takes the lowest index it touches, until nothing changes: the slow obvious version.
Tensor components_by_relabelling(const Tensor& grid) {
  const std::int64_t n = grid.size(0);
  Tensor label = torch::arange(grid.numel()).view(grid.sizes()).clone();
  auto at = label.accessor<std::int64_t, 3>();
  const auto there = grid.accessor<bool, 3>();
  for (bool changed = true; changed;) {
    changed = false;
    for (std::int64_t x = 0; x < n; ++x)
      for (std::int64_t y = 0; y < n; ++y)
        for (std::int64_t z = 0; z < n; ++z) {
          if (!there[x][y][z]) continue;
          const auto take = [&](std::int64_t i, std::int64_t j, std::int64_t k) {
            if (i >= n || j >= n || k >= n || !there[i][j][k]) return;
            const std::int64_t low = std::min(at[x][y][z], at[i][j][k]);
            changed = changed || at[x][y][z] != at[i][j][k];
            at[x][y][z] = at[i][j][k] = low;
          };
          take(x + 1, y, z);
          take(x, y + 1, z);
          take(x, y, z + 1);
        }
  }
  return torch::where(grid, label, torch::full_like(label, -1));
}

TEST(LargestComponent, IsWhatRelabellingFinds) {
  torch::manual_seed(3);
  for (int trial = 0; trial < 20; ++trial) {
    const Tensor grid = torch::rand({7, 7, 7}) < 0.3;
    const Tensor label = components_by_relabelling(grid);
    std::int64_t best = -1, most = 0;
    for (std::int64_t l = 0; l < grid.numel(); ++l) {
      const auto count = (label == l).sum().item<std::int64_t>();
      if (count > most) {
        most = count;
        best = l;
      }
    }
    EXPECT_TRUE(torch::equal(largest_component(grid), label == best)) << trial;
  }
}

TEST(LargestComponent, CornersDoNotTouchAndTheFirstOfEqualOnesStays) {
  Tensor grid = empty_grid(4);
  grid[0][0][0] = grid[1][1][1] = true;
  const Tensor kept = largest_component(grid);
  EXPECT_TRUE(kept[0][0][0].item<bool>());
  EXPECT_EQ(kept.sum().item<std::int64_t>(), 1);
}

TEST(LargestComponent, OfNothingIsNothing) {
  EXPECT_FALSE(largest_component(empty_grid(3)).any().item<bool>());
  EXPECT_THROW(largest_component(torch::zeros({3, 3})), InputError);
}

TEST(VoxelsInside, OfABoxAreItsInteriorAndItself) {
  const Tensor box = hollow_box(9, 2, 7);
  Tensor solid = empty_grid(9);
  solid.slice(0, 2, 7).slice(1, 2, 7).slice(2, 2, 7).fill_(true);
  EXPECT_TRUE(torch::equal(enclosed_voxels(box), solid));
}

TEST(VoxelsInside, ForgiveAHoleInTheSurface) {
  Tensor box = hollow_box(9, 2, 7);
  box[2][4][4] = false;
  EXPECT_TRUE(enclosed_voxels(box)[4][4][4].item<bool>());
  EXPECT_FALSE(enclosed_voxels(box)[1][4][4].item<bool>());
}

TEST(VoxelsInside, GiveTheShareOfASkeleton) {
  const Tensor box = hollow_box(9, 2, 7);
  Tensor bone = empty_grid(9);
  bone[4][4].slice(0, 4, 8).fill_(true);  // z 4, 5 inside, 6 on the surface, 7 outside
  EXPECT_DOUBLE_EQ(share_inside(bone, box), 0.75);
  EXPECT_DOUBLE_EQ(share_inside(empty_grid(9), box), 1.0);
  EXPECT_THROW(share_inside(empty_grid(8), box), InputError);
}

}  // namespace
}  // namespace anigen::models
