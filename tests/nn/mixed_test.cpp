#include "anigen/nn/kernels/mixed_products.h"

#include <gtest/gtest.h>

#include <vector>

#include "anigen/nn/linear.h"

namespace anigen::nn {
namespace {

Tensor rounded(const Tensor& x) { return x.to(torch::kBFloat16).to(torch::kFloat32); }

double share_apart(const Tensor& a, const Tensor& b) {
  return ((a - b).abs().max() / (b.abs().max() + 1e-30)).item<double>();
}

struct LinearCase {
  std::int64_t rows, in, out;
};

class MixedLinear : public testing::TestWithParam<LinearCase> {
  void SetUp() override {
    const MixedProducts on(true);
    if (!mixed_products()) GTEST_SKIP() << "no products of bf16 numbers here";
  }
};

// Values that bf16 holds exactly: the same products, so that only sums may be rounded differently.
TEST_P(MixedLinear, RoundsFactorsAlone) {
  const LinearCase c = GetParam();
  torch::manual_seed(3);
  const Tensor x = rounded(torch::randn({c.rows, c.in})).requires_grad_(),
               w = rounded(torch::randn({c.out, c.in})).requires_grad_();
  const Tensor b = torch::randn({c.out}).requires_grad_(), direction = rounded(torch::randn({c.rows, c.out}));
  const Tensor wanted = torch::linear(x, w, b), given = mixed_linear(x, w, b);
  EXPECT_LT(share_apart(given, wanted), 1e-5);
  const auto slopes = [&](const Tensor& y) { return torch::autograd::grad({y}, {x, w, b}, {direction}); };
  const auto given_slopes = slopes(given), wanted_slopes = slopes(wanted);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_LT(share_apart(given_slopes[i], wanted_slopes[i]), 1e-5) << i;
}

TEST_P(MixedLinear, BitsDoNotDependOnThreads) {
  const LinearCase c = GetParam();
  torch::manual_seed(4);
  const Tensor x = torch::randn({c.rows, c.in}).requires_grad_(), w = torch::randn({c.out, c.in}).requires_grad_();
  std::vector<Tensor> first;
  const int before = torch::get_num_threads();
  for (const int threads : {1, 2, 3}) {
    torch::set_num_threads(threads);
    const Tensor y = mixed_linear(x, w, {});
    std::vector<Tensor> results = torch::autograd::grad({y.square().sum()}, {x, w});
    results.push_back(y);
    if (first.empty()) first = results;
    for (std::size_t i = 0; i < results.size(); ++i) EXPECT_TRUE(torch::equal(results[i], first[i])) << i;
  }
  torch::set_num_threads(before);
}

INSTANTIATE_TEST_SUITE_P(Sizes, MixedLinear,
                         testing::Values(LinearCase{1, 16, 16}, LinearCase{97, 16, 48}, LinearCase{200, 144, 80},
                                         LinearCase{331, 320, 16}, LinearCase{64, 528, 208}, LinearCase{200, 32, 101},
                                         LinearCase{130, 37, 21}));

TEST(PrefersMixedLinear, IsForWidthsOfAVectorAndManyRows) {
  const MixedProducts on(true);
  if (!mixed_products()) GTEST_SKIP() << "no products of bf16 numbers here";
  EXPECT_TRUE(prefers_mixed_linear(torch::zeros({2, 40, 32}), torch::zeros({16, 32})));
  EXPECT_TRUE(prefers_mixed_linear(torch::zeros({80, 37}), torch::zeros({101, 37})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({8, 32}), torch::zeros({16, 32})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}), torch::zeros({3, 32})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}, torch::kFloat64), torch::zeros({16, 32}, torch::kFloat64)));
  const MixedProducts off(false);
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}), torch::zeros({16, 32})));
}

}  // namespace
}  // namespace anigen::nn
