#include "anigen/nn/fused_mlp.h"

#include <gtest/gtest.h>

#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {
namespace {

// The result and the gradients of the operation and of separate layers, for a number of rows that fills no block.
struct Case {
  Case() {
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
  const Case c;
  EXPECT_LT(largest_difference(c.fused(), c.separate()), 1e-5);  // sums of 48 products of size one
}

KERNEL_TEST(FusedMlp, GradientsEqualThoseOfSeparateLayers) {
  const Case c;
  const std::vector<Tensor> found = c.gradients(c.fused()), wanted = c.gradients(c.separate());
  for (std::size_t i = 0; i < found.size(); ++i) {
    // Sums over 3011 rows: fp32 rounding relative to the largest entry.
    EXPECT_LT(largest_difference(found[i], wanted[i]), 2e-5 * (1.0 + wanted[i].abs().max().item<double>())) << i;
  }
}

TEST(FusedMlp, InputWithoutGradient) {
  const Case c;
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
}  // namespace anigen::nn
