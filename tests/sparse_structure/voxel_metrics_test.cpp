#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "anigen/core/error.h"
#include "anigen/sparse_structure/voxel_metrics.h"

namespace anigen::sparse_structure {

namespace {

using torch::Tensor;
using Cell = std::array<std::int64_t, 3>;

std::vector<Cell> cells_of(const Tensor& grid) {
  std::vector<Cell> cells;
  const Tensor indices = grid.nonzero();
  for (std::int64_t i = 0; i < indices.size(0); ++i) {
    const Tensor row = indices[i];
    cells.push_back({row[0].item<std::int64_t>(), row[1].item<std::int64_t>(), row[2].item<std::int64_t>()});
  }
  return cells;
}

bool near_any(const Cell& cell, const std::vector<Cell>& others, std::int64_t tolerance) {
  return std::any_of(others.begin(), others.end(), [&](const Cell& other) {
    std::int64_t distance = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) distance = std::max(distance, std::abs(cell[axis] - other[axis]));
    return distance <= tolerance;
  });
}

double share_near(const std::vector<Cell>& cells, const std::vector<Cell>& others, std::int64_t tolerance) {
  if (cells.empty()) return 1.0;
  const auto near =
      std::count_if(cells.begin(), cells.end(), [&](const Cell& cell) { return near_any(cell, others, tolerance); });
  return static_cast<double>(near) / static_cast<double>(cells.size());
}

TEST(VoxelMetrics, AgreeWithCountingCellByCell) {
  torch::manual_seed(6);
  for (int round = 0; round < 8; ++round) {
    const double density = round % 2 == 0 ? 0.02 : 0.2;
    const Tensor p = torch::rand({7, 6, 5}) < density, t = torch::rand({7, 6, 5}) < density;
    const std::vector<Cell> predicted = cells_of(p), target = cells_of(t);
    for (const std::int64_t tolerance : {0, 1, 2}) {
      const VoxelAgreement found = voxel_agreement(p, t, tolerance);
      const double precision = share_near(predicted, target, tolerance);
      const double recall = share_near(target, predicted, tolerance);
      EXPECT_DOUBLE_EQ(found.precision, precision);
      EXPECT_DOUBLE_EQ(found.recall, recall);
      EXPECT_DOUBLE_EQ(found.f1, precision + recall > 0.0 ? 2.0 * precision * recall / (precision + recall) : 0.0);
      const double common = share_near(predicted, target, 0) * static_cast<double>(predicted.size());
      const double either = static_cast<double>(predicted.size() + target.size()) - common;
      EXPECT_NEAR(found.iou, either > 0.0 ? common / either : 1.0, 1e-12);
    }
  }
}

TEST(VoxelMetrics, EmptySets) {
  const Tensor none = torch::zeros({4, 4, 4}, torch::kBool), all = torch::ones({4, 4, 4}, torch::kBool);
  EXPECT_EQ(voxel_agreement(none, none).iou, 1.0);
  EXPECT_EQ(voxel_agreement(none, none).f1, 1.0);
  EXPECT_EQ(voxel_agreement(none, all).iou, 0.0);
  EXPECT_EQ(voxel_agreement(none, all).f1, 0.0);  // nothing found: precision 1, recall 0
  EXPECT_EQ(voxel_agreement(all, none).f1, 0.0);
}

TEST(VoxelMetrics, DilationIsACubeClippedByTheGrid) {
  Tensor grid = torch::zeros({5, 5, 5}, torch::kBool);
  grid[0][2][4] = true;
  EXPECT_EQ(dilated_voxels(grid, 1).sum().item<std::int64_t>(), 2 * 3 * 2);
  EXPECT_TRUE(torch::equal(dilated_voxels(grid, 0), grid));
}

TEST(VoxelMetrics, RefuseOtherShapes) {
  const Tensor grid = torch::zeros({4, 4, 4}, torch::kBool);
  EXPECT_THROW(voxel_agreement(grid, torch::zeros({4, 4, 5}, torch::kBool)), InputError);
  EXPECT_THROW(voxel_agreement(grid[0], grid[0]), InputError);
}

}  // namespace

namespace {

using torch::Tensor;

TEST(SparseStructureLoss, DiceIsOfTheWholeBatch) {
  // σ = ½ everywhere; one occupied voxel of two in the first item, none in the second.
  const Tensor logits = torch::zeros({2, 1, 2, 1, 1});
  Tensor occupancy = torch::zeros({2, 1, 2, 1, 1}, torch::kInt64);
  occupancy[0][0][0][0][0] = 1;
  EXPECT_NEAR(occupancy_loss(logits, occupancy, OccupancyLoss::kDice).item<double>(), 1.0 - 2.0 / 4.0, 1e-6);
  EXPECT_NEAR(occupancy_loss(logits, occupancy, OccupancyLoss::kBce).item<double>(), std::log(2.0), 1e-6);
  EXPECT_NEAR(occupancy_loss(logits, occupancy, OccupancyLoss::kL1).item<double>(), 0.5, 1e-6);
}

TEST(SparseStructureLoss, SixteenBitLogitsAreSummedInSinglePrecision) {
  torch::manual_seed(7);
  const Tensor logits = torch::randn({1, 1, 16, 16, 16}).to(torch::kBFloat16);
  const Tensor occupancy = torch::rand({1, 1, 16, 16, 16}) < 0.1;
  for (const OccupancyLoss loss : {OccupancyLoss::kDice, OccupancyLoss::kBce, OccupancyLoss::kL1}) {
    EXPECT_EQ(occupancy_loss(logits, occupancy, loss).item<float>(),
              occupancy_loss(logits.to(torch::kFloat32), occupancy, loss).item<float>());
    EXPECT_EQ(occupancy_loss_named(name_of(loss)), loss);
  }
}

TEST(SparseStructureLoss, DivergenceOfAGaussian) {
  EXPECT_EQ(posterior_kl(torch::zeros({3}), torch::zeros({3})).item<double>(), 0.0);
  // KL(N(2, 4) ‖ N(0, 1)) = ½ (4 + 4 − ln 4 − 1)
  const Tensor mean = torch::full({1}, 2.0, torch::kFloat64), logvar = torch::full({1}, std::log(4.0), torch::kFloat64);
  EXPECT_NEAR(posterior_kl(mean, logvar).item<double>(), 0.5 * (7.0 - std::log(4.0)), 1e-12);
}

TEST(SparseStructureLoss, RefusesOtherShapesAndWords) {
  EXPECT_THROW(occupancy_loss(torch::zeros({2}), torch::zeros({1}), OccupancyLoss::kDice), InputError);
  EXPECT_THROW(occupancy_loss_named("mse"), InputError);
}

}  // namespace

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

}  // namespace anigen::sparse_structure
