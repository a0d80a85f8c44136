#include "anigen/nn/gelu.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/kernel_forms.h"

namespace anigen::nn {
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

KERNEL_TEST(Gelu, NotFiniteStaysNotFinite) {
  const float infinity = std::numeric_limits<float>::infinity();
  const Tensor y = gelu_tanh(torch::tensor({std::numeric_limits<float>::quiet_NaN(), infinity, -1000.0F, 1000.0F}));
  EXPECT_TRUE(y[0].isnan().item<bool>());
  EXPECT_EQ(y[1].item<float>(), infinity);
  EXPECT_NEAR(y[2].item<double>(), 0.0, 1e-30);
  EXPECT_EQ(y[3].item<float>(), 1000.0F);
}

}  // namespace
}  // namespace anigen::nn
