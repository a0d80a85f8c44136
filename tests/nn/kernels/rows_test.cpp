#include "anigen/nn/kernels/rows.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "anigen/nn/norms.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {
namespace {

constexpr double kEps = 1e-6;

struct Case {
  std::vector<std::int64_t> lengths;
  std::int64_t channels;
};

// No row, one row, more rows than a block has; channels that do not fill a vector, one channel.
const std::vector<Case> kCases = {{{3, 0, 1}, 7},    {{2500, 0, 40}, 48}, {{5}, 1},         {{0, 0}, 16},
                                  {{700, 900}, 128}, {{3000, 2000}, 8},   {{90, 1600}, 24}, {{33}, 20}};

struct Inputs {
  Tensor x, scale, shift, result, direction;

  Inputs to(torch::Dtype dtype) const {
    const auto copy = [&](const Tensor& t) { return t.detach().to(dtype).clone().requires_grad_(); };
    return {copy(x), copy(scale), copy(shift), copy(result), direction.to(dtype)};
  }
};

Inputs random_inputs(const Case& of, torch::Dtype rounded_to) {
  torch::manual_seed(of.channels);
  const Ragged items(of.lengths);
  const auto draw = [&](std::int64_t rows) {
    return torch::randn({rows, of.channels}).to(rounded_to).to(torch::kFloat64);
  };
  return {3.0 + 2.0 * draw(items.rows()), draw(items.items()), draw(items.items()), draw(items.rows()),
          draw(items.rows())};
}

// Of the results and gradients, relative to the largest number of each.
double largest_error(const std::vector<Tensor>& found, const std::vector<Tensor>& exact) {
  double worst = 0.0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    if (exact[i].numel() == 0) continue;
    const double scale = 1.0 + exact[i].abs().max().item<double>();
    worst = std::max(worst, largest_difference(found[i].to(torch::kFloat64), exact[i]) / scale);
  }
  return worst;
}

std::vector<Tensor> modulate(const Inputs& in, const Ragged& items) {
  const Tensor y = modulated_norm(in.x, items, in.shift, in.scale, kEps);
  (y * in.direction).sum().backward();
  return {y.detach(), in.x.grad(), in.shift.grad(), in.scale.grad()};
}

std::vector<Tensor> gate(const Inputs& in, const Ragged& items) {
  const Tensor y = add_gated(in.x, items, in.scale, in.result);
  (y * in.direction).sum().backward();
  return {y.detach(), in.x.grad(), in.result.grad(), in.scale.grad()};
}

// fp64 has no kernels: it is LibTorch's layer norm and sums.
KERNEL_TEST(ModulatedRows, KernelsAgreeWithDoublePrecision) {
  for (const Case& of : kCases) {
    const Ragged items(of.lengths);
    const Inputs exact = random_inputs(of, torch::kFloat32);
    // One channel has no variance: x − μ is rounding, a thousand times as large after the division by √eps.
    const double tolerance = of.channels == 1 ? 1e-3 : 2e-6;
    EXPECT_LT(largest_error(modulate(exact.to(torch::kFloat32), items), modulate(exact.to(torch::kFloat64), items)),
              tolerance)
        << of.channels << " channels";
    EXPECT_LT(largest_error(gate(exact.to(torch::kFloat32), items), gate(exact.to(torch::kFloat64), items)), 2e-6);
  }
}

KERNEL_TEST(ModulatedRows, Bf16IsRoundedOnceAtTheEnd) {
  for (const Case& of : kCases) {
    if (of.channels == 1) continue;
    const Ragged items(of.lengths);
    const Inputs exact = random_inputs(of, torch::kBFloat16);
    // 2^-8: half a unit in the last of 8 digits is at most 2^-9 of the number; x itself was rounded for both
    const Inputs rounded = exact.to(torch::kBFloat16).to(torch::kFloat64);
    EXPECT_LT(
        largest_error(modulate(rounded.to(torch::kBFloat16), items), modulate(rounded.to(torch::kFloat64), items)),
        1.0 / 256.0)
        << of.channels << " channels";
    EXPECT_LT(largest_error(gate(rounded.to(torch::kBFloat16), items), gate(rounded.to(torch::kFloat64), items)),
              1.0 / 256.0);
  }
}

KERNEL_TEST(ModulatedRows, GradientsAgreeWithFiniteDifferences) {
  const Case of{{4, 3}, 5};
  const Ragged items(of.lengths);
  const Inputs in = random_inputs(of, torch::kFloat32).to(torch::kFloat32);
  modulate(in, items);
  const auto value = [&](const Tensor& x) {  // in fp64, where differences have digits
    const Inputs wide = in.to(torch::kFloat64);
    return (modulated_norm(x, items, wide.shift, wide.scale, kEps) * wide.direction).sum().item<double>();
  };
  const Tensor x = in.x.detach().to(torch::kFloat64);
  for (std::int64_t i = 0; i < x.numel(); ++i) {
    const double h = 1e-5;
    Tensor above = x.clone(), below = x.clone();
    above.view(-1)[i] += h;
    below.view(-1)[i] -= h;
    EXPECT_NEAR(in.x.grad().view(-1)[i].item<double>(), (value(above) - value(below)) / (2.0 * h), 2e-5) << i;
  }
}

// Numbers of a row that differ by little beside their mean: what is left is their difference, not the mean's rounding.
KERNEL_TEST(ModulatedRows, RowsFarFromZeroAreCentred) {
  const Tensor constant = torch::full({4, 1024}, 1234.567F), weight = torch::ones({1024}), bias = torch::zeros({1024});
  EXPECT_LT(affine_norm(constant, weight, bias, kEps).abs().max().item<double>(), 0.1);
  const Tensor near = 1000.0 + torch::randn({4, 1024});
  const Tensor exact = torch::layer_norm(near.to(torch::kFloat64), {1024}, {}, {}, kEps);
  EXPECT_LT(largest_difference(affine_norm(near, weight, bias, kEps).to(torch::kFloat64), exact), 2e-4);
}

KERNEL_TEST(ModulatedRows, AffineNormOfAnyShape) {
  const Tensor x = torch::randn({3, 4, 50}).transpose(0, 1), weight = torch::randn({50}), bias = torch::randn({50});
  const Tensor exact =
      torch::layer_norm(x.to(torch::kFloat64), {50}, weight.to(torch::kFloat64), bias.to(torch::kFloat64), kEps);
  const Tensor found = affine_norm(x, weight, bias, kEps);
  EXPECT_EQ(found.sizes(), x.sizes());
  EXPECT_LT(largest_difference(found.to(torch::kFloat64), exact), 2e-6);
  EXPECT_EQ(affine_norm(torch::empty({0, 50}), weight, bias, kEps).size(0), 0);
}

KERNEL_TEST(ModulatedRows, ResultsDoNotDependOnTheThreads) {
  const Case of{{3000, 2000}, 64};
  const Ragged items(of.lengths);
  const Inputs exact = random_inputs(of, torch::kFloat32);
  const int before = torch::get_num_threads();
  std::vector<std::vector<Tensor>> found;
  for (const int threads : {1, 2, 3}) {
    torch::set_num_threads(threads);
    found.push_back(modulate(exact.to(torch::kFloat32), items));
    for (const Tensor& t : gate(exact.to(torch::kFloat32), items)) found.back().push_back(t);
  }
  torch::set_num_threads(before);
  for (const std::vector<Tensor>& other : found) {
    for (std::size_t i = 0; i < other.size(); ++i) EXPECT_TRUE(torch::equal(other[i], found[0][i])) << i;
  }
}

KERNEL_TEST(ModulatedRows, NotFiniteStaysNotFinite) {
  const Ragged items({2});
  for (const torch::Dtype dtype : {torch::kFloat32, torch::kBFloat16}) {
    Tensor x = torch::randn({2, 20}).to(dtype);
    x[0][3] = std::numeric_limits<float>::quiet_NaN();
    const Tensor y = modulated_norm(x, items, torch::zeros({1, 20}, dtype), torch::zeros({1, 20}, dtype), kEps);
    EXPECT_TRUE(y[0].isnan().all().item<bool>());
    EXPECT_TRUE(y[1].isfinite().all().item<bool>());
  }
}

TEST(ModulatedRows, WrongSizesAreNamed) {
  const Ragged items({2, 3});
  const Tensor x = torch::randn({5, 8}), one = torch::randn({1, 8}), two = torch::randn({2, 8});
  EXPECT_THROW(modulated_norm(x, items, one, two, kEps), c10::Error);
  EXPECT_THROW(add_gated(x, items, one, x), c10::Error);
  EXPECT_THROW(add_gated(x, items, two, x.narrow(0, 0, 4)), c10::Error);
  EXPECT_THROW(affine_norm(x, torch::ones({7}), torch::zeros({7}), kEps), c10::Error);
}

std::vector<Tensor> normed_heads(const Tensor& projected, const Tensor& gamma, const Tensor& direction) {
  MultiHeadRmsNorm norm(gamma.size(1), gamma.size(0));
  norm->to(gamma.scalar_type());
  norm->gamma.data().copy_(gamma);
  const Tensor rows = projected.detach().clone().requires_grad_();
  const Tensor heads = rows.view({rows.size(0), 3, gamma.size(0), gamma.size(1)}).select(1, 1);  // rows far apart
  const Tensor y = norm->forward(heads);
  (y * direction).sum().backward();
  return {y.detach(), rows.grad(), norm->gamma.grad()};
}

KERNEL_TEST(MultiHeadRmsNorm, KernelsAgreeWithDoublePrecision) {
  for (const std::int64_t channels : {5, 16, 40, 64}) {
    torch::manual_seed(channels);
    Tensor projected = torch::randn({1200, 3 * 4 * channels});
    projected[7].zero_();  // shorter than 1e-12: multiplied with a constant
    const Tensor gamma = torch::randn({4, channels}), direction = torch::randn({1200, 4, channels});
    const auto in = [&](torch::Dtype dtype) {
      return normed_heads(projected.to(dtype), gamma.to(dtype), direction.to(dtype));
    };
    const std::vector<Tensor> exact = in(torch::kFloat64), found = in(torch::kFloat32);
    EXPECT_LT(largest_error({found[0], found[2]}, {exact[0], exact[2]}), 3e-6) << channels;
    // The zero row's gradient is 1e12 of the slope; all others by themselves.
    const auto others = [](const Tensor& t) { return torch::cat({t.narrow(0, 0, 7), t.narrow(0, 8, 1192)}); };
    EXPECT_LT(largest_error({others(found[1])}, {others(exact[1])}), 3e-6) << channels;
    EXPECT_LT(largest_error({found[1][7] / 1e12}, {exact[1][7] / 1e12}), 3e-6) << channels;

    const std::vector<Tensor> half =
        normed_heads(projected.to(torch::kBFloat16), gamma.to(torch::kBFloat16), direction.to(torch::kBFloat16));
    EXPECT_LT(largest_error({half[0], half[2]}, {exact[0], exact[2]}), 0.03) << channels;  // rounded inputs
  }
}

}  // namespace
}  // namespace anigen::nn
