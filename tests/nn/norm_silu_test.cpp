#include "anigen/nn/norm_silu.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "anigen/nn/volume_layers.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {
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
