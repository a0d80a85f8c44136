#include "anigen/nn/gelu_erf.h"

#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <vector>

namespace anigen::nn {

namespace {

TEST(GeluErf, IsTheExactForm) {
  const Tensor x = torch::linspace(-6, 6, 1001, torch::kFloat64);
  const Tensor expected = 0.5 * x * (1.0 + torch::erf(x / std::sqrt(2.0)));
  EXPECT_LT((gelu_erf(x) - expected).abs().max().item<double>(), 1e-12);
}

// LibTorch 1.13 leaves most of the gradient unwritten when x is contiguous and the slopes are not.
TEST(GeluErf, GradientIsRightForSlopesOfAnyLayout) {
  torch::manual_seed(3);
  for (const auto format : {torch::MemoryFormat::Contiguous, torch::MemoryFormat::ChannelsLast}) {
    const Tensor x = torch::randn({2, 8, 4, 4}).requires_grad_();
    const Tensor slopes = torch::randn({2, 8, 4, 4}).contiguous(format);
    {
      // Memory that was used before is not zero.
      std::vector<Tensor> used;
      for (int i = 0; i < 100; ++i) used.push_back(torch::full({256}, std::numeric_limits<float>::quiet_NaN()));
    }
    gelu_erf(x).backward(slopes);
    const Tensor u = x.detach();
    const Tensor density = torch::exp(-0.5 * u * u) / std::sqrt(2.0 * 3.14159265358979);
    const Tensor expected = slopes * (0.5 * (1.0 + torch::erf(u / std::sqrt(2.0))) + u * density);
    EXPECT_LT((x.grad() - expected).abs().max().item<double>(), 1e-5);
  }
}

}  // namespace

}  // namespace anigen::nn
