#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/volumes.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

// Layers of volumes, low-rank additions, and what initialisation leaves behind.

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

namespace {

constexpr double kVolumeEps = 1e-5;

struct ActivatedInputs {
  Tensor x, weight, bias, direction;

  ActivatedInputs to(torch::Dtype dtype) const {
    const auto copy = [&](const Tensor& t) { return t.detach().to(dtype).clone().requires_grad_(); };
    return {copy(x), copy(weight), copy(bias), direction.to(dtype)};
  }
};

ActivatedInputs random_rows(std::int64_t rows, std::int64_t channels) {
  torch::manual_seed(channels);
  return {0.5 + 2.0 * torch::randn({rows, channels}), 1.0 + torch::randn({channels}), torch::randn({channels}),
          torch::randn({rows, channels})};
}

// The result and the gradients of x, weight and bias.
std::vector<Tensor> activate(const ActivatedInputs& in) {
  const Tensor y = norm_silu(in.x, in.weight, in.bias, kVolumeEps);
  (y * in.direction).sum().backward();
  return {y.detach(), in.x.grad(), in.weight.grad(), in.bias.grad()};
}

// fp64 has no kernel: it is LibTorch's layer norm and SiLU. Rows that fill vectors and that do not, more rows than a
// block and than a cache hold, rows longer than either.
KERNEL_TEST(NormSilu, KernelAgreesWithDoublePrecision) {
  for (const auto& [rows, channels] : {std::pair<std::int64_t, std::int64_t>{9000, 8},
                                       {1700, 24},
                                       {600, 64},
                                       {1, 16},
                                       {300, 20},
                                       {40, 7},
                                       {3, 5000},
                                       {2, 40000}}) {
    const ActivatedInputs in = random_rows(rows, channels);
    const std::vector<Tensor> found = activate(in.to(torch::kFloat32)), exact = activate(in.to(torch::kFloat64));
    for (std::size_t i = 0; i < exact.size(); ++i) {
      const double scale = 1.0 + exact[i].abs().max().item<double>();
      EXPECT_LT(largest_difference(found[i].to(torch::kFloat64), exact[i]) / scale, 3e-6) << channels << ", " << i;
    }
  }
}

KERNEL_TEST(NormSilu, GradientsAgreeWithFiniteDifferences) {
  const ActivatedInputs in = random_rows(6, 8).to(torch::kFloat32);
  const std::vector<Tensor> found = activate(in);
  const ActivatedInputs wide = in.to(torch::kFloat64);  // where differences have digits
  const std::vector<Tensor> of = {wide.x.detach(), wide.weight.detach(), wide.bias.detach()};
  for (std::size_t k = 0; k < of.size(); ++k) {
    for (std::int64_t i = 0; i < of[k].numel(); ++i) {
      const auto value = [&](double step) {
        std::vector<Tensor> moved = {of[0].clone(), of[1].clone(), of[2].clone()};
        moved[k].view(-1)[i] += step;
        return (norm_silu(moved[0], moved[1], moved[2], kVolumeEps) * wide.direction).sum().item<double>();
      };
      const double h = 1e-5;
      EXPECT_NEAR(found[k + 1].view(-1)[i].item<double>(), (value(h) - value(-h)) / (2.0 * h), 3e-5) << k << ", " << i;
    }
  }
}

KERNEL_TEST(NormSilu, ResultsDoNotDependOnTheThreads) {
  const ActivatedInputs in = random_rows(20000, 24);
  const int before = torch::get_num_threads();
  std::vector<std::vector<Tensor>> found;
  for (const int threads : {1, 2, 3}) {
    torch::set_num_threads(threads);
    found.push_back(activate(in.to(torch::kFloat32)));
  }
  torch::set_num_threads(before);
  for (const std::vector<Tensor>& other : found) {
    for (std::size_t i = 0; i < other.size(); ++i) EXPECT_TRUE(torch::equal(other[i], found[0][i])) << i;
  }
}

KERNEL_TEST(NormSilu, LargeNumbersAndThoseThatAreNotFinite) {
  Tensor x = torch::randn({3, 8});
  x[0][3] = std::numeric_limits<float>::quiet_NaN();
  const Tensor large = torch::full({8}, 500.0F), none = torch::zeros({8});
  const Tensor y = norm_silu(x, large, none, kVolumeEps);
  EXPECT_TRUE(y[0].isnan().all().item<bool>());
  EXPECT_LT(largest_difference(y.narrow(0, 1, 2),
                               torch::silu(torch::layer_norm(x.narrow(0, 1, 2), {8}, large, none, kVolumeEps))),
            1e-3);
  EXPECT_TRUE(norm_silu(torch::full({2, 8}, 1e8F), large, none, kVolumeEps).isfinite().all().item<bool>())
      << "no variance";
  EXPECT_EQ(norm_silu(torch::empty({0, 8}), large, none, kVolumeEps).sizes(), (std::vector<std::int64_t>{0, 8}));
  EXPECT_THROW(norm_silu(x, torch::ones({7}), torch::zeros({7}), kVolumeEps), c10::Error);
}

TEST(NormSilu, OnlyTheFirstDerivative) {
  const ActivatedInputs in = random_rows(4, 8).to(torch::kFloat32);
  const Tensor y = norm_silu(in.x, in.weight, in.bias, kVolumeEps).sum();
  EXPECT_THROW(torch::autograd::grad({y}, {in.x}, {}, true, /*create_graph=*/true), c10::Error);
}

// Of both kinds, in both memory formats, which are kept.
KERNEL_TEST(NormSilu, OfVolumes) {
  for (const VolumeNormImpl::Kind kind : {VolumeNormImpl::Kind::kLayer, VolumeNormImpl::Kind::kGroup}) {
    VolumeNorm norm(24, kind, 4);
    torch::NoGradGuard no_gradient;
    norm->weight.normal_();
    norm->bias.normal_();
    const Tensor x = torch::randn({2, 24, 5, 6, 7});
    for (const torch::MemoryFormat format : {torch::MemoryFormat::Contiguous, torch::MemoryFormat::ChannelsLast3d}) {
      const Tensor laid = x.contiguous(format), found = norm->activated(laid);
      EXPECT_LT(largest_difference(found, torch::silu(norm->forward(x))), 1e-5);
      if (kind == VolumeNormImpl::Kind::kLayer) {
        EXPECT_TRUE(found.is_contiguous(format));
      }
    }
  }
}

}  // namespace

}  // namespace anigen::nn
