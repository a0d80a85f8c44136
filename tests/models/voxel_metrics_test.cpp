#include "anigen/models/voxel_metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "anigen/core/error.h"

namespace anigen::models {
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
}  // namespace anigen::models
