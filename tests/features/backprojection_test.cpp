#include "anigen/features/backprojection.h"

#include <gtest/gtest.h>

#include <cmath>

namespace anigen::features {
namespace {

// A camera at (0, 0, -2) that looks along +z with x right and y down; at distance 2 it sees [-1, 1]².
Tensor extrinsics() {
  Tensor matrix = torch::eye(4);
  matrix[2][3] = 2.0;
  return matrix.unsqueeze(0);
}

Tensor intrinsics() {
  Tensor matrix = torch::eye(3);
  for (int axis = 0; axis < 2; ++axis) {
    matrix[axis][axis] = 1.0;
    matrix[axis][2] = 0.5;
  }
  return matrix.unsqueeze(0);
}

TEST(ProjectPoints, CentreCornersAndDepth) {
  const Tensor points =
      torch::tensor({{0.0F, 0.0F, 0.0F}, {-1.0F, -1.0F, 0.0F}, {1.0F, 0.5F, 0.0F}, {1.0F, 0.0F, 2.0F}});
  const Tensor uv = project_points(points, extrinsics(), intrinsics())[0];
  const Tensor expected = torch::tensor({{0.0F, 0.0F}, {-1.0F, -1.0F}, {1.0F, 0.5F}, {0.5F, 0.0F}});
  EXPECT_TRUE(torch::allclose(uv, expected, 1e-6, 1e-6)) << uv;
}

TEST(SamplePatches, BilinearBetweenPatchCentresRowByRow) {
  // Patches 0 1 / 2 3 of a 2 × 2 grid; their centres lie at ±0.5.
  const Tensor patches = torch::arange(4, torch::kFloat32).view({1, 4, 1});
  const Tensor uv =
      torch::tensor({{-0.5F, -0.5F}, {0.5F, -0.5F}, {-0.5F, 0.5F}, {0.0F, 0.0F}, {1.0F, -0.5F}}).unsqueeze(0);
  const Tensor found = sample_patches(patches, 2, 2, uv)[0].flatten();
  // The last lies on the picture's edge, half a patch beyond the last centre: half of patch 1, half nothing.
  EXPECT_TRUE(torch::allclose(found, torch::tensor({0.0F, 1.0F, 2.0F, 1.5F, 0.5F}), 1e-6, 1e-6)) << found;
}

TEST(SamplePatches, OutsideIsZeroWhateverTheNumber) {
  const Tensor patches = torch::ones({1, 1, 3});
  const float nan = std::nanf(""), infinite = INFINITY;
  const Tensor uv =
      torch::tensor({{3.0F, 0.0F}, {-1e30F, 0.0F}, {nan, 0.0F}, {0.0F, infinite}, {-infinite, nan}, {0.0F, 0.0F}})
          .unsqueeze(0);
  const Tensor found = sample_patches(patches, 1, 1, uv)[0];
  EXPECT_EQ(found.slice(0, 0, 5).abs().max().item<float>(), 0.0F) << found;
  EXPECT_EQ(found[5][2].item<float>(), 1.0F);
}

TEST(ViewMean, CountsEveryViewAndForgetsTheBatches) {
  torch::manual_seed(1);
  const Tensor per_view = torch::randn({7, 5, 3});
  ViewMean at_once, one_by_one;
  at_once.add(per_view);
  for (std::int64_t v = 0; v < 7; ++v) one_by_one.add(per_view.slice(0, v, v + 1));
  EXPECT_TRUE(torch::equal(at_once.mean(), one_by_one.mean()));
  EXPECT_TRUE(torch::allclose(at_once.mean(), per_view.mean(0), 1e-5, 1e-6));

  ViewMean half_seen;
  half_seen.add(torch::full({1, 2, 1}, 6.0F));
  half_seen.add(torch::zeros({2, 2, 1}));
  EXPECT_EQ(half_seen.mean()[1][0].item<float>(), 2.0F);
  EXPECT_EQ(half_seen.views(), 3);
}

TEST(ViewMean, LeavesItsInputAlone) {
  const Tensor first = torch::ones({1, 2, 1});
  ViewMean mean;
  mean.add(first);
  mean.add(first);
  EXPECT_EQ(first[0][0][0].item<float>(), 1.0F);
}

}  // namespace
}  // namespace anigen::features
