#include "anigen/models/sparse_structure_loss.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::models {
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
}  // namespace anigen::models
