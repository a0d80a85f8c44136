#include "anigen/nn/widened_linear.h"

#include <gtest/gtest.h>

#include "tests/support/kernel_forms.h"

namespace anigen::nn {
namespace {

Tensor leaf(const Tensor& values) { return values.to(torch::kBFloat16).requires_grad_(); }

// The same layer in fp32 on the same, already rounded numbers differs by one rounding of each result: 2^-8 of it.
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
