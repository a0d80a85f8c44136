#include "anigen/nn/kernels/mixed_products.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <tuple>
#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/ragged_attention.h"

namespace anigen::nn {
namespace {

Tensor rounded(const Tensor& x) { return x.to(torch::kBFloat16).to(torch::kFloat32); }

double share_apart(const Tensor& a, const Tensor& b) {
  return ((a - b).abs().max() / (b.abs().max() + 1e-30)).item<double>();
}

// Products stay in this form for the length of a test.
class InForm {
 public:
  explicit InForm(MixedForm form) : on_(form) {}
  void require() const {
    if (!mixed_products()) GTEST_SKIP() << "not supported: products of bf16 numbers on this CPU";
  }

 private:
  MixedProducts on_;
};

const auto kForms = testing::Values(MixedForm::kKernels, MixedForm::kEmulated);

struct LinearCase {
  std::int64_t rows, in, out;
};

class MixedLinear : public testing::TestWithParam<std::tuple<MixedForm, LinearCase>>, InForm {
 public:
  MixedLinear() : InForm(std::get<0>(GetParam())) {}
  void SetUp() override { require(); }
};

// Values that bf16 holds exactly: the same products, so that only sums may be rounded differently.
TEST_P(MixedLinear, RoundsFactorsAlone) {
  const LinearCase c = std::get<1>(GetParam());
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

// Emulated products are the library's, whose bits depend on threads as those of fp32 do.
class MixedKernels : public testing::TestWithParam<LinearCase>, InForm {
 public:
  MixedKernels() : InForm(MixedForm::kKernels) {}
  void SetUp() override { require(); }
};

TEST_P(MixedKernels, BitsDoNotDependOnThreads) {
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

const auto kLinearCases =
    testing::Values(LinearCase{1, 16, 16}, LinearCase{97, 16, 48}, LinearCase{200, 144, 80}, LinearCase{331, 320, 16},
                    LinearCase{64, 528, 208}, LinearCase{200, 32, 101}, LinearCase{130, 37, 21});
INSTANTIATE_TEST_SUITE_P(Sizes, MixedLinear, testing::Combine(kForms, kLinearCases));
INSTANTIATE_TEST_SUITE_P(Sizes, MixedKernels, kLinearCases);

// Layers whose weight is a view of another tensor, as Anymate's point encoder has them.
TEST(LinearInTheFastestWay, TakesSlicesOfWeightsAndFollowsThePrecision) {
  torch::manual_seed(5);
  const Tensor x = torch::randn({4, 50, 32}), whole = torch::randn({48, 64, 1}).requires_grad_(),
               b = torch::randn({48});
  const Tensor w = whole.squeeze(-1).slice(1, 32);
  EXPECT_TRUE(torch::equal(nn::linear(x, w, b), torch::linear(x, w, b)));
  const Tensor wanted = torch::autograd::grad({torch::linear(x, w, b).square().sum()}, {whole})[0];
  const MixedProducts on(MixedForm::kEmulated);
  const Tensor y = nn::linear(x, w, b);
  EXPECT_TRUE(torch::equal(y, mixed_linear(x, w, b)));
  EXPECT_LT(share_apart(torch::autograd::grad({y.square().sum()}, {whole})[0], wanted), 2e-2);
  EXPECT_TRUE(nn::linear(x, w).defined()) << "without a bias";
}

TEST(PrefersMixedLinear, IsForWidthsOfAVectorAndManyRows) {
  const MixedProducts on(MixedForm::kEmulated);
  EXPECT_TRUE(prefers_mixed_linear(torch::zeros({2, 40, 32}), torch::zeros({16, 32})));
  EXPECT_TRUE(prefers_mixed_linear(torch::zeros({80, 37}), torch::zeros({101, 37})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({8, 32}), torch::zeros({16, 32})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}), torch::zeros({3, 32})));
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}, torch::kFloat64), torch::zeros({16, 32}, torch::kFloat64)));
  const MixedProducts off(MixedForm::kNone);
  EXPECT_FALSE(prefers_mixed_linear(torch::zeros({80, 32}), torch::zeros({16, 32})));
}

struct MixedAttentionCase {
  std::vector<std::int64_t> queries, keys;
  std::int64_t heads, channels;
};

class MixedAttention : public testing::TestWithParam<std::tuple<MixedForm, MixedAttentionCase>>, InForm {
 public:
  MixedAttention() : InForm(std::get<0>(GetParam())) {}
  void SetUp() override { require(); }
  MixedForm form() const { return std::get<0>(GetParam()); }
  const MixedAttentionCase& sizes() const { return std::get<1>(GetParam()); }
};

struct AttentionResults {
  Tensor out, dq, dk, dv;
};

AttentionResults attend_mixed(const MixedAttentionCase& c, MixedForm form, std::int64_t seed) {
  const MixedProducts on(form);
  torch::manual_seed(static_cast<std::uint64_t>(seed));
  const Ragged queries(c.queries), keys(c.keys);
  const auto numbers = [&](std::int64_t rows) { return torch::randn({rows, c.heads, c.channels}).requires_grad_(); };
  const Tensor q = numbers(queries.rows()), k = numbers(keys.rows()), v = numbers(keys.rows());
  const Tensor out = ragged_attention(q, k, v, queries.row_offsets(), keys.row_offsets());
  const auto slopes = torch::autograd::grad({out}, {q, k, v}, {torch::randn(out.sizes())});
  return {out.detach(), slopes[0], slopes[1], slopes[2]};
}

// Each product of rounded factors is off by 2^-8 of itself at most, 2^-9.5 on average; errors of a sum are independent.
TEST_P(MixedAttention, IsOffByTheRoundingOfItsFactors) {
  const AttentionResults given = attend_mixed(sizes(), form(), 5), wanted = attend_mixed(sizes(), MixedForm::kNone, 5);
  const auto apart = [](const Tensor& a, const Tensor& b) {
    return ((a - b).norm() / (b.norm() + 1e-9)).item<double>();
  };
  EXPECT_LT(apart(given.out, wanted.out), 4e-3);
  EXPECT_LT(apart(given.dq, wanted.dq), 8e-3);
  EXPECT_LT(apart(given.dk, wanted.dk), 8e-3);
  EXPECT_LT(apart(given.dv, wanted.dv), 8e-3);
  EXPECT_LT(share_apart(given.out, wanted.out), 0.02);
  EXPECT_LT(share_apart(given.dq, wanted.dq), 0.03);
  EXPECT_LT(share_apart(given.dk, wanted.dk), 0.03);
  EXPECT_LT(share_apart(given.dv, wanted.dv), 0.03);
}

TEST_P(MixedAttention, BitsDoNotDependOnThreads) {
  const int before = torch::get_num_threads();
  torch::set_num_threads(1);
  const AttentionResults first = attend_mixed(sizes(), form(), 6);
  for (const int threads : {2, 3}) {
    torch::set_num_threads(threads);
    const AttentionResults other = attend_mixed(sizes(), form(), 6);
    EXPECT_TRUE(torch::equal(other.out, first.out) && torch::equal(other.dq, first.dq) &&
                torch::equal(other.dk, first.dk) && torch::equal(other.dv, first.dv));
  }
  torch::set_num_threads(before);
}

INSTANTIATE_TEST_SUITE_P(Sizes, MixedAttention,
                         testing::Combine(kForms,
                                          testing::Values(MixedAttentionCase{{1}, {2}, 1, 16},
                                                          MixedAttentionCase{{5, 37}, {33, 3}, 2, 32},
                                                          MixedAttentionCase{{140, 7, 0, 64}, {140, 0, 9, 65}, 3, 48},
                                                          MixedAttentionCase{{128, 131}, {256, 24}, 2, 64},
                                                          MixedAttentionCase{{300, 12}, {700, 1100}, 2, 64})));

// Both round the same factors. Weights are rounded as shares of the largest score of a block, and blocks of the two
// differ, so that their errors, 2^-9.5 of a weight on average, are independent in long sequences.
TEST_P(MixedAttention, EveryFormRoundsAlike) {
  const AttentionResults kernels = attend_mixed(sizes(), MixedForm::kKernels, 8),
                         emulated = attend_mixed(sizes(), MixedForm::kEmulated, 8);
  const MixedProducts on(MixedForm::kKernels);
  if (!mixed_products()) GTEST_SKIP() << "not supported: products of bf16 numbers on this CPU";
  const auto apart = [](const Tensor& a, const Tensor& b) {
    return ((a - b).norm() / (b.norm() + 1e-9)).item<double>();
  };
  EXPECT_LT(apart(emulated.out, kernels.out), 3e-3);
  EXPECT_LT(apart(emulated.dq, kernels.dq), 6e-3);
  EXPECT_LT(apart(emulated.dk, kernels.dk), 6e-3);
  EXPECT_LT(apart(emulated.dv, kernels.dv), 3e-3);
}

TEST(RoundInPlace, GivesTheNearestBf16NumberOfEveryKind) {
  const float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> values{0.0F,    -0.0F,    1.0F,   1.00390625F, 1.01171875F, -3.1415927F,
                            3.4e38F, -3.4e38F, 1e-40F, infinity,    -infinity,   nan};
  const Tensor wanted = rounded(torch::tensor(values));
  kernels::round_in_place(values.data(), static_cast<std::int64_t>(values.size()));
  EXPECT_TRUE(torch::equal(torch::tensor(values).slice(0, 0, 11), wanted.slice(0, 0, 11)));
  EXPECT_TRUE(std::isnan(values[11]));
}

class MixedAttentionOf : public testing::TestWithParam<MixedForm>, InForm {
 public:
  MixedAttentionOf() : InForm(GetParam()) {}
  void SetUp() override { require(); }
};
INSTANTIATE_TEST_SUITE_P(Forms, MixedAttentionOf, kForms);

TEST_P(MixedAttentionOf, DenseBatchesAreSequencesOfOneLength) {
  torch::manual_seed(7);
  const auto numbers = [](std::int64_t rows) { return torch::randn({2, rows, 3, 32}).transpose(1, 2); };
  const Tensor q = numbers(600), k = numbers(300), v = numbers(300);
  const Tensor given = blocked_attention(q, k, v);
  const auto rows = [](const Tensor& x) { return x.transpose(1, 2).reshape({-1, 3, 32}); };
  const Tensor wanted =
      ragged_attention(rows(q), rows(k), rows(v), Ragged({600, 600}).row_offsets(), Ragged({300, 300}).row_offsets());
  EXPECT_TRUE(torch::equal(rows(given), wanted));
}

TEST_P(MixedAttentionOf, NotFiniteScoresAreSeenInTheirRowOnly) {
  Tensor q = torch::randn({20, 1, 32});
  const Tensor k = torch::randn({9, 1, 32}), v = torch::randn({9, 1, 32});
  q[4][0][3] = std::numeric_limits<float>::quiet_NaN();
  const Tensor out = ragged_attention(q, k, v, Ragged({20}).row_offsets(), Ragged({9}).row_offsets());
  EXPECT_TRUE(out[4].isnan().all().item<bool>());
  EXPECT_EQ(out.isnan().sum().item<std::int64_t>(), 32);
}

}  // namespace
}  // namespace anigen::nn
