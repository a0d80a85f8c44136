// Layers of volumes, low-rank additions, and what initialisation leaves behind.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/init.h"
#include "anigen/nn/rms_norm.h"
#include "anigen/nn/volume_layers.h"

namespace anigen::nn {
namespace {

double largest(const Tensor& x) { return x.abs().max().item<double>(); }

Lora rank(std::int64_t rank, double scale) {
  Lora lora;
  lora.rank = rank;
  lora.scale = scale;
  return lora;
}

TEST(Linear, LowRankAddition) {
  torch::manual_seed(31);
  Linear linear(5, 4, true, rank(2, 0.5));
  linear->to(torch::kFloat64);
  {
    const torch::NoGradGuard no_grad;
    for (Tensor& parameter : linear->parameters()) parameter.normal_();
  }
  const Tensor x = torch::randn({2, 3, 5}, torch::kFloat64);
  const Tensor weight = linear->weight + 0.5 * linear->lora_A.mm(linear->lora_B).t();
  EXPECT_LT(largest(linear->forward(x) - torch::linear(x, weight, linear->bias)), 1e-13);
  EXPECT_EQ(Linear(5, 4)->parameters().size(), 2U);
}

TEST(VolumeNorm, LayerNormsTheChannelsOfEachVoxel) {
  torch::manual_seed(32);
  VolumeNorm norm(6);
  default_norms(*norm);
  norm->to(torch::kFloat64);
  const Tensor x = 3.0 * torch::randn({2, 6, 3, 4, 2}, torch::kFloat64) + 1.0;
  const Tensor y = norm->forward(x);
  const Tensor centred = x - x.mean({1}, true);
  EXPECT_LT(largest(y - centred / (centred.square().mean({1}, true) + 1e-5).sqrt()), 1e-12);
  EXPECT_TRUE(y.is_contiguous());
}

TEST(VolumeNorm, GroupNormsTheGroupOverAllVoxels) {
  torch::manual_seed(33);
  VolumeNorm norm(6, VolumeNormImpl::Kind::kGroup, 3);
  default_norms(*norm);
  norm->to(torch::kFloat64);
  const Tensor x = torch::randn({2, 6, 3, 4, 2}, torch::kFloat64);
  const Tensor rows = x.view({2, 3, 48}), centred = rows - rows.mean({2}, true);
  const Tensor wanted = centred / (centred.square().mean({2}, true) + 1e-5).sqrt();
  EXPECT_LT(largest(norm->forward(x) - wanted.view_as(x)), 1e-12);
  EXPECT_THROW(VolumeNorm(6, VolumeNormImpl::Kind::kGroup), c10::Error);  // 32 groups
}

TEST(MultiHeadRmsNorm, UnitHeadsTimesGammaAndRootOfWidth) {
  MultiHeadRmsNorm norm(4, 2);
  const Tensor x = torch::tensor({{3.0F, 0.0F, 4.0F, 0.0F}, {0.0F, 0.0F, 0.0F, 0.0F}}).view({1, 2, 4});
  const Tensor y = norm->forward(x);
  EXPECT_NEAR(y[0][0][0].item<double>(), 2.0 * 0.6, 1e-6);
  EXPECT_NEAR(y[0][0][2].item<double>(), 2.0 * 0.8, 1e-6);
  EXPECT_EQ(largest(y[0][1]), 0.0);  // a zero vector stays zero
  EXPECT_EQ(norm->forward(x.to(torch::kBFloat16)).scalar_type(), torch::kBFloat16);
}

TEST(Conv3d, IsACrossCorrelation) {
  Conv3d convolution(1, 1, 3, 1, 1);
  {
    const torch::NoGradGuard no_grad;
    convolution->weight.zero_();
    convolution->weight[0][0][2][1][1] = 1.0;  // the neighbour above along x
    convolution->bias.fill_(0.5);
  }
  const Tensor x = torch::arange(8, torch::kFloat32).view({1, 1, 2, 2, 2});
  const Tensor y = convolution->forward(x);
  EXPECT_TRUE(torch::equal(y[0][0][0], x[0][0][1] + 0.5));
  EXPECT_TRUE(torch::equal(y[0][0][1], torch::full({2, 2}, 0.5)));
  EXPECT_EQ(Conv3d(2, 3, 2, 2)->forward(torch::zeros({1, 2, 4, 6, 8})).sizes(),
            (std::vector<std::int64_t>{1, 3, 2, 3, 4}));
}

// Uniform draws reach to within 5 % of the bound: the chance of missing it with n draws is 0.95^n.
void expect_uniform(const Tensor& values, double bound) {
  EXPECT_LE(largest(values), bound);
  EXPECT_GT(largest(values), 0.95 * bound);
}

TEST(Init, LowRankFactors) {
  torch::manual_seed(34);
  Linear linear(40, 50, true, rank(20, 0.1));
  xavier_uniform_linears(*linear);
  EXPECT_EQ(largest(linear->lora_A), 0.0);
  EXPECT_NEAR(linear->lora_B.std().item<double>(), 0.01, 0.002);  // 1000 draws: a standard error of 0.0002
  expect_uniform(linear->weight, std::sqrt(6.0 / 90.0));
}

TEST(Init, KaimingUniformLinears) {
  torch::manual_seed(35);
  Linear linear(40, 50);
  kaiming_uniform_linears(*linear);
  expect_uniform(linear->weight, std::sqrt(3.0 / 40.0));
  EXPECT_EQ(largest(linear->bias), 0.0);
}

TEST(Init, DefaultConvolutions) {
  torch::manual_seed(36);
  Conv3d convolution(4, 200, 3);
  default_convolutions(*convolution);
  expect_uniform(convolution->weight, 1.0 / std::sqrt(4.0 * 27.0));
  expect_uniform(convolution->bias, 1.0 / std::sqrt(4.0 * 27.0));
  EXPECT_TRUE(is_linear_or_convolution(*convolution));
}

TEST(Init, NormalLinearAndZeros) {
  torch::manual_seed(37);
  Linear linear(40, 50);
  normal_linear(*linear);
  EXPECT_NEAR(linear->weight.std().item<double>(), 0.02, 0.002);  // 2000 draws: a standard error of 0.0003
  EXPECT_EQ(largest(linear->bias), 0.0);
  zero_parameters(*linear);
  EXPECT_EQ(largest(linear->weight), 0.0);
}

TEST(Init, Norms) {
  AffineLayerNorm norm(7, 1e-6);
  default_norms(*norm);
  EXPECT_EQ(largest(norm->weight - 1.0), 0.0);
  EXPECT_EQ(largest(norm->bias), 0.0);
}

}  // namespace
}  // namespace anigen::nn
