#include <gtest/gtest.h>
#include <cmath>
#include <limits>

#include "anigen/nn/init.h"
#include "anigen/nn/kernels/activations.h"
#include "anigen/nn/linear.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {

namespace {

// The result and the gradients of the operation and of separate layers, for a number of rows that fills no block.
struct FusedMlpCase {
  FusedMlpCase() {
    torch::manual_seed(5);
    for (const std::vector<std::int64_t>& shape :
         std::vector<std::vector<std::int64_t>>{{3011, 6}, {48, 6}, {48}, {5, 48}, {5}}) {
      arguments.push_back((0.5 * torch::randn(shape)).requires_grad_());
    }
    direction = torch::randn({3011, 5});
  }
  std::vector<Tensor> arguments;
  Tensor direction;

  Tensor fused() const { return fused_mlp(arguments[0], arguments[1], arguments[2], arguments[3], arguments[4]); }
  Tensor separate() const {
    const Tensor hidden = torch::gelu(torch::linear(arguments[0], arguments[1], arguments[2]), "tanh");
    return torch::linear(hidden, arguments[3], arguments[4]);
  }
  std::vector<Tensor> gradients(const Tensor& result) const {
    return torch::autograd::grad({(result * direction).sum()}, arguments);
  }
};

KERNEL_TEST(FusedMlp, EqualsSeparateLayers) {
  const FusedMlpCase c;
  EXPECT_LT(largest_difference(c.fused(), c.separate()), 1e-5);  // sums of 48 products of size one
}

KERNEL_TEST(FusedMlp, GradientsEqualThoseOfSeparateLayers) {
  const FusedMlpCase c;
  const std::vector<Tensor> found = c.gradients(c.fused()), wanted = c.gradients(c.separate());
  for (std::size_t i = 0; i < found.size(); ++i) {
    // Sums over 3011 rows: fp32 rounding relative to the largest entry.
    EXPECT_LT(largest_difference(found[i], wanted[i]), 2e-5 * (1.0 + wanted[i].abs().max().item<double>())) << i;
  }
}

TEST(FusedMlp, InputWithoutGradient) {
  const FusedMlpCase c;
  const Tensor x = c.arguments[0].detach();
  const Tensor y = fused_mlp(x, c.arguments[1], c.arguments[2], c.arguments[3], c.arguments[4]);
  const Tensor found = torch::autograd::grad({(y * c.direction).sum()}, {c.arguments[1]})[0];
  const Tensor wanted = c.gradients(c.separate())[1];
  EXPECT_LT(largest_difference(found, wanted), 2e-5 * (1.0 + wanted.abs().max().item<double>()));
}

TEST(FusedMlp, ChosenForManyRowsOfModerateWidthOnly) {
  EXPECT_TRUE(prefers_fused_mlp(torch::empty({100000, 32}), torch::empty({128, 32})));
  EXPECT_FALSE(prefers_fused_mlp(torch::empty({100, 32}), torch::empty({128, 32})));
  EXPECT_FALSE(prefers_fused_mlp(torch::empty({100000, 32}), torch::empty({8192, 32})));
  EXPECT_FALSE(
      prefers_fused_mlp(torch::empty({100000, 32}, torch::kFloat64), torch::empty({128, 32}, torch::kFloat64)));
}

KERNEL_TEST(Mlp, ManyRowsEqualFewRows) {
  // 20000 rows take the fused way, 100 the other.
  torch::manual_seed(6);
  Mlp mlp(6, 48, 5);
  xavier_uniform_linears(*mlp);
  const Tensor x = torch::randn({20000, 6});
  EXPECT_LT(largest_difference(mlp->forward(x).narrow(0, 500, 100), mlp->forward(x.narrow(0, 500, 100))), 1e-5);
}

}  // namespace

namespace {

Tensor range() { return torch::linspace(-12.0, 12.0, 40001, torch::kFloat64); }

KERNEL_TEST(Gelu, AgreesWithDoublePrecision) {
  const Tensor wanted = torch::gelu(range(), "tanh");
  const Tensor found = gelu_tanh(range().to(torch::kFloat32)).to(torch::kFloat64);
  // fp32 rounding of values up to 12, and of the exponent's argument
  EXPECT_LT(((found - wanted).abs() / (1.0 + wanted.abs())).max().item<double>(), 4e-7);
}

KERNEL_TEST(Gelu, GradientAgreesWithDoublePrecision) {
  Tensor exact = range().requires_grad_(), x = range().to(torch::kFloat32).requires_grad_();
  const Tensor direction = torch::sin(range());
  (torch::gelu(exact, "tanh") * direction).sum().backward();
  (gelu_tanh(x) * direction.to(torch::kFloat32)).sum().backward();
  EXPECT_LT((x.grad().to(torch::kFloat64) - exact.grad()).abs().max().item<double>(), 3e-6);
}

KERNEL_TEST(Gelu, DoublesAndViewsGiveTheSame) {
  const Tensor x = range().narrow(0, 0, 40000).view({200, 200}).t();
  EXPECT_LT((gelu_tanh(x) - gelu_tanh(x.to(torch::kFloat32))).abs().max().item<double>(), 1e-5);
}

KERNEL_TEST(Gelu, OfBf16NumbersIsRoundedOnce) {
  const Tensor x = range().to(torch::kBFloat16), exact = torch::gelu(x.to(torch::kFloat64), "tanh");
  const torch::NoGradGuard no_grad;
  const Tensor y = gelu_tanh(x);
  ASSERT_EQ(y.scalar_type(), torch::kBFloat16);
  // Half a unit in the last place of 8 bits, the error of fp32, and that of 1 + tanh in fp64.
  const Tensor error = (y.to(torch::kFloat64) - exact).abs();
  EXPECT_TRUE((error <= exact.abs() * (1.0 / 256.0 + 1e-5) + 1e-14).all().item<bool>());
  const float infinity = std::numeric_limits<float>::infinity();
  const Tensor odd = gelu_tanh(torch::tensor({std::nanf(""), infinity}).to(torch::kBFloat16)).to(torch::kFloat32);
  EXPECT_TRUE(std::isnan(odd[0].item<float>()));
  EXPECT_EQ(odd[1].item<float>(), infinity);
}

KERNEL_TEST(Gelu, NotFiniteStaysNotFinite) {
  const float infinity = std::numeric_limits<float>::infinity();
  const Tensor y = gelu_tanh(torch::tensor({std::numeric_limits<float>::quiet_NaN(), infinity, -1000.0F, 1000.0F}));
  EXPECT_TRUE(y[0].isnan().item<bool>());
  EXPECT_EQ(y[1].item<float>(), infinity);
  EXPECT_NEAR(y[2].item<double>(), 0.0, 1e-30);
  EXPECT_EQ(y[3].item<float>(), 1000.0F);
}

}  // namespace

namespace {

Tensor leaf(const Tensor& values) { return values.to(torch::kBFloat16).requires_grad_(); }

KERNEL_TEST(SumOfRows, IsTheSumAndItsBitsDoNotDependOnThreads) {
  torch::manual_seed(6);
  const Tensor rows = torch::randn({5000, 60}), wanted = rows.to(torch::kFloat64).sum(0);
  const int before = torch::get_num_threads();
  std::vector<Tensor> sums;
  for (const int threads : {1, 3}) {
    torch::set_num_threads(threads);
    sums.push_back(sum_of_rows(rows));
  }
  torch::set_num_threads(before);
  EXPECT_TRUE(torch::equal(sums[0], sums[1]));
  EXPECT_TRUE(torch::allclose(sums[0].to(torch::kFloat64), wanted, 1e-5, 1e-4));
  EXPECT_TRUE(torch::allclose(sum_of_rows(rows.narrow(1, 7, 21)), sums[0].narrow(0, 7, 21), 1e-5, 1e-4));
  EXPECT_TRUE(torch::allclose(sum_of_rows(rows.t()), rows.sum(1), 1e-5, 1e-4));
  EXPECT_EQ(sum_of_rows(torch::zeros({0, 4})).abs().max().item<float>(), 0.0F);
}

TEST(WidenedLinear, IsTheWideLayerRoundedOnce) {
  torch::manual_seed(3);
  for (const bool with_bias : {true, false}) {
    const Tensor x = leaf(torch::randn({2, 5, 12})), w = leaf(torch::randn({7, 12})), b = leaf(torch::randn({7}));
    const auto wide = [](const Tensor& t) { return t.detach().to(torch::kFloat32).requires_grad_(); };
    const Tensor wide_x = wide(x), wide_w = wide(w), wide_b = wide(b);
    const Tensor y = widened_linear(x, w, with_bias ? b : Tensor());
    const Tensor expected = torch::linear(wide_x, wide_w, with_bias ? wide_b : Tensor());
    EXPECT_EQ(y.scalar_type(), torch::kBFloat16);
    EXPECT_TRUE(torch::equal(y, expected.to(torch::kBFloat16)));

    const Tensor weights = torch::randn({2, 5, 7}).to(torch::kBFloat16);
    (y * weights).sum().backward();
    (expected * weights.to(torch::kFloat32)).sum().backward();
    EXPECT_TRUE(torch::allclose(x.grad().to(torch::kFloat32), wide_x.grad(), 0.005, 1e-5));
    EXPECT_TRUE(torch::allclose(w.grad().to(torch::kFloat32), wide_w.grad(), 0.005, 1e-5));
    EXPECT_EQ(b.grad().defined(), with_bias);
    if (with_bias) {
      EXPECT_TRUE(torch::allclose(b.grad().to(torch::kFloat32), wide_b.grad(), 0.005, 1e-5));
    }
  }
}

TEST(WidenedLinear, IsForNarrowFormsOfKernels) {
  const Tensor x = torch::randn({4, 3}).to(torch::kBFloat16), w = torch::randn({2, 3}).to(torch::kBFloat16);
  for (const KernelForm form : {KernelForm::kPortable, KernelForm::kAvx2}) {
    if (form > runnable_kernel_forms().back()) continue;
    const KernelFormScope scope(form);
    EXPECT_TRUE(prefers_widened_linear(x, w)) << kernel_form_name(form);
  }
}

TEST(WidenedLinear, IsForSixteenBitsOnly) {
  const Tensor x = torch::randn({4, 3}), w = torch::randn({2, 3});
  EXPECT_FALSE(prefers_widened_linear(x, w));
  EXPECT_FALSE(prefers_widened_linear(x.to(torch::kFloat64), w.to(torch::kFloat64)));
}

}  // namespace

}  // namespace anigen::nn
