#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <ostream>
#include <utility>
#include <vector>

#include "anigen/nn/ragged_attention.h"
#include "tests/nn/attention_results.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {

namespace {

using test::expect_close;
using test::share_of_difference;

using RaggedFunction = Tensor (*)(const Tensor&, const Tensor&, const Tensor&, const Tensor&, const Tensor&);

Tensor offsets_of_lengths(const std::vector<std::int64_t>& lengths) {
  std::vector<std::int64_t> offsets{0};
  for (const std::int64_t length : lengths) offsets.push_back(offsets.back() + length);
  return torch::tensor(offsets, torch::TensorOptions().dtype(torch::kInt64));
}

// Sequence by sequence, from the definition.
Tensor attention_per_sequence(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                              const Tensor& k_offsets) {
  std::vector<Tensor> parts{q.narrow(0, 0, 0)};
  for (std::int64_t s = 0; s + 1 < q_offsets.size(0); ++s) {
    const auto part = [&](const Tensor& x, const Tensor& offsets) {
      const std::int64_t first = offsets[s].item<std::int64_t>();
      return x.narrow(0, first, offsets[s + 1].item<std::int64_t>() - first).transpose(0, 1);  // [H, n, D]
    };
    const Tensor queries = part(q, q_offsets), keys = part(k, k_offsets), values = part(v, k_offsets);
    if (keys.size(1) == 0) {
      parts.push_back(torch::zeros_like(queries).transpose(0, 1));
      continue;
    }
    const double scale = 1.0 / std::sqrt(static_cast<double>(q.size(2)));
    const Tensor weights = torch::softmax(torch::matmul(queries, keys.transpose(1, 2)) * scale, -1);
    parts.push_back(torch::matmul(weights, values).transpose(0, 1));
  }
  return torch::cat(parts, 0);
}

struct RaggedSizes {
  std::int64_t heads, channels;
  std::vector<std::int64_t> queries, keys;
};
std::ostream& operator<<(std::ostream& out, const RaggedSizes& s) {
  return out << s.queries.size() << " sequences, " << s.heads << " heads of " << s.channels << " channels";
}

// Queries, keys, values and a direction for the gradient, fp64; scores of a few units, so that weights differ.
struct RaggedCase {
  explicit RaggedCase(const RaggedSizes& s)
      : q_offsets(offsets_of_lengths(s.queries)), k_offsets(offsets_of_lengths(s.keys)) {
    torch::manual_seed(41);
    const auto random = [&](const Tensor& offsets) {
      return torch::randn({offsets[-1].item<std::int64_t>(), s.heads, s.channels}, torch::kFloat64);
    };
    q = 2.0 * random(q_offsets);
    k = random(k_offsets);
    v = random(k_offsets);
    direction = random(q_offsets);
  }
  Tensor q_offsets, k_offsets, q, k, v, direction;

  test::AttentionResults run(RaggedFunction attention, torch::Dtype dtype) const {
    std::vector<Tensor> inputs;
    for (const Tensor& x : {q, k, v}) inputs.push_back(x.to(dtype).detach().clone().requires_grad_());
    const Tensor out = attention(inputs[0], inputs[1], inputs[2], q_offsets, k_offsets);
    return {out.detach(), torch::autograd::grad({out}, inputs, {direction.to(dtype)})};
  }
};

class RaggedAttentionSizes : public testing::TestWithParam<RaggedSizes> {};

TEST_P(RaggedAttentionSizes, KernelsAgreeWithTheDefinition) {
  const RaggedCase c(GetParam());
  const auto wanted = c.run(attention_per_sequence, torch::kFloat64);
  // fp32 sums of up to some thousand terms of size one: a few times 1e-6 of the largest value.
  test::in_every_kernel_form([&] { expect_close(c.run(ragged_attention, torch::kFloat32), wanted, 2e-5); });
}

TEST_P(RaggedAttentionSizes, TensorOperationsAgreeWithTheDefinition) {
  const RaggedCase c(GetParam());
  const auto wanted = c.run(attention_per_sequence, torch::kFloat64);
  expect_close(c.run(ragged_attention, torch::kFloat64), wanted, 1e-11);
  expect_close(c.run(tensor_ragged_attention, torch::kFloat32), wanted, 2e-5);
}

// One row; sequences without rows, of one, and longer than every block; queries without keys and keys without queries;
// blocks of 128 queries and 256 keys filled exactly, and not; many short windows, which share tasks.
INSTANTIATE_TEST_SUITE_P(
    Sizes, RaggedAttentionSizes,
    testing::Values(RaggedSizes{1, 1, {1}, {1}}, RaggedSizes{3, 5, {0, 1, 17, 513, 2, 0}, {0, 1, 17, 513, 2, 0}},
                    RaggedSizes{2, 20, {3, 0, 130, 4, 1}, {5, 7, 300, 0, 700}},
                    RaggedSizes{2, 16, {128, 129, 256}, {256, 257, 512}},
                    RaggedSizes{12, 64, {40, 64, 100, 7}, {40, 64, 100, 7}},
                    RaggedSizes{4, 32, std::vector<std::int64_t>(60, 3), std::vector<std::int64_t>(60, 5)},
                    RaggedSizes{1, 8, {2000, 1}, {1, 2000}}));

TEST(RaggedAttention, GradientMatchesFiniteDifferences) {
  const RaggedCase c({2, 4, {5, 0, 9, 3}, {4, 2, 7, 0}});
  const auto loss = [&](const Tensor& q, const Tensor& k, const Tensor& v) {
    return (ragged_attention(q, k, v, c.q_offsets, c.k_offsets) * c.direction).sum().item<double>();
  };
  const std::vector<Tensor> gradients = c.run(ragged_attention, torch::kFloat64).gradients;
  const Tensor dq = torch::randn_like(c.q), dk = torch::randn_like(c.k), dv = torch::randn_like(c.v);
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-15 / h
  const double slope =
      (loss(c.q + h * dq, c.k + h * dk, c.v + h * dv) - loss(c.q - h * dq, c.k - h * dk, c.v - h * dv)) / (2 * h);
  const Tensor found = (gradients[0] * dq).sum() + (gradients[1] * dk).sum() + (gradients[2] * dv).sum();
  EXPECT_NEAR(found.item<double>(), slope, 1e-6 * (1.0 + std::abs(slope)));
}

KERNEL_TEST(RaggedAttention, QueriesWithoutKeysGiveExactlyZeroAndNoGradient) {
  const RaggedCase c({2, 8, {3, 4, 2}, {5, 0, 6}});
  for (const torch::Dtype dtype : {torch::kFloat32, torch::kFloat64, torch::kBFloat16}) {
    const auto found = c.run(ragged_attention, dtype);
    EXPECT_TRUE((found.out.narrow(0, 3, 4) == 0).all().item<bool>()) << dtype;
    EXPECT_TRUE((found.gradients[0].narrow(0, 3, 4) == 0).all().item<bool>()) << dtype;
    EXPECT_TRUE((found.out.narrow(0, 0, 3) != 0).all().item<bool>()) << dtype;
  }
}

TEST(RaggedAttention, NoRowsAtAll) {
  const Tensor none = torch::zeros({0, 2, 8}), start = offsets_of_lengths({});
  EXPECT_EQ(ragged_attention(none, none, none, start, start).sizes(), none.sizes());
  const Tensor empty_items = offsets_of_lengths({0, 0});
  EXPECT_EQ(ragged_attention(none, none, none, empty_items, empty_items).sizes(), none.sizes());
  EXPECT_EQ(tensor_ragged_attention(none, none, none, empty_items, empty_items).sizes(), none.sizes());
}

KERNEL_TEST(RaggedAttention, SixteenBitInputs) {
  for (const RaggedSizes& sizes :
       {RaggedSizes{2, 16, {140, 30, 1}, {270, 30, 2}}, RaggedSizes{3, 64, {97, 4, 33, 1}, {64, 0, 100, 513}},
        RaggedSizes{1, 32, {200, 5, 190}, {40, 1030, 80}}}) {
    const RaggedCase c(sizes);
    for (const auto& [dtype, digits] : {std::pair(torch::kBFloat16, 8), std::pair(torch::kHalf, 11)}) {
      // The inputs are rounded first, so that only our own rounding counts: of the result, and of what is saved.
      RaggedCase rounded = c;
      for (Tensor* x : {&rounded.q, &rounded.k, &rounded.v, &rounded.direction}) *x = x->to(dtype).to(torch::kFloat64);
      const auto found = rounded.run(ragged_attention, dtype);
      EXPECT_EQ(found.out.scalar_type(), dtype);
      expect_close(found, rounded.run(attention_per_sequence, torch::kFloat64), 4.0 * std::exp2(-digits));
    }
  }
}

KERNEL_TEST(RaggedAttention, TheSameBitsForAnyNumberOfThreads) {
  const int before = at::get_num_threads();
  const RaggedCase c({5, 16, {300, 2, 70, 33, 33, 1}, {700, 2, 70, 33, 31, 1}});
  for (const torch::Dtype dtype : {torch::kFloat32, torch::kBFloat16}) {
    at::set_num_threads(1);
    const auto wanted = c.run(ragged_attention, dtype);
    for (const int threads : {2, 3}) {
      at::set_num_threads(threads);
      const auto found = c.run(ragged_attention, dtype);
      EXPECT_TRUE(torch::equal(found.out, wanted.out)) << threads;
      for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(torch::equal(found.gradients[i], wanted.gradients[i])) << threads;
    }
  }
  at::set_num_threads(before);
}

KERNEL_TEST(RaggedAttention, LargeScoresDoNotOverflow) {
  RaggedCase c({1, 8, {40, 3}, {530, 3}});
  c.q = c.q * 30.0;  // scores of some hundreds: nearly all weight on one key, which may be in any block of keys
  // Rounding moves scores of 200 by 2e-5, and weights by as large a share.
  expect_close(c.run(ragged_attention, torch::kFloat32), c.run(attention_per_sequence, torch::kFloat64), 1e-3);
}

// One key wins by billions, in whichever block of keys it is: no rounding of a score may give weights above one.
KERNEL_TEST(RaggedAttention, EnormousScoresPickTheirKey) {
  constexpr std::int64_t kKeys = 600, kChannels = 48;  // a scale that is no power of two
  torch::manual_seed(9);
  const Tensor q = torch::full({7, 1, kChannels}, 3e4F), v = torch::randn({kKeys, 1, kChannels});
  const Tensor offsets = torch::tensor({0, 7}, torch::kInt64), k_offsets = torch::tensor({0, 600}, torch::kInt64);
  for (const std::int64_t winner : {std::int64_t{3}, kKeys - 1}) {
    Tensor k = torch::rand({kKeys, 1, kChannels}) * 1e4;
    k[winner].fill_(3.3e4F);
    const Tensor out = ragged_attention(q, k, v, offsets, k_offsets);
    EXPECT_TRUE(torch::allclose(out, v[winner].expand_as(out), 1e-6, 1e-6)) << winner;
  }
}

// Fewer tasks than threads, and not many more: every one is done, whoever takes it.
TEST(RaggedAttention, FewTasksAreDealtOut) {
  const int before = at::get_num_threads();
  const RaggedCase c({3, 16, {40}, {40}});
  at::set_num_threads(1);
  const Tensor wanted = c.run(ragged_attention, torch::kFloat32).out;
  for (const int threads : {2, 3, 4, 8}) {
    at::set_num_threads(threads);
    EXPECT_TRUE(torch::equal(c.run(ragged_attention, torch::kFloat32).out, wanted)) << threads;
  }
  at::set_num_threads(before);
}

KERNEL_TEST(RaggedAttention, NotFiniteScoresAreSeenInTheirRowOnly) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::quiet_NaN(),
                          std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()}) {
    const RaggedCase c({1, 8, {4, 5}, {300, 5}});
    const Tensor q = c.q.to(torch::kFloat32);
    q[2].fill_(bad);
    const Tensor out =
        ragged_attention(q, c.k.to(torch::kFloat32).abs(), c.v.to(torch::kFloat32), c.q_offsets, c.k_offsets);
    EXPECT_TRUE(out[2].isnan().all().item<bool>()) << bad;
    EXPECT_EQ(out.isfinite().all(-1).all(-1).sum().item<std::int64_t>(), 8) << bad;
  }
}

KERNEL_TEST(RaggedAttention, StridedInputsGiveTheSame) {
  // As a projection leaves them: q, k and v side by side in each row.
  torch::manual_seed(42);
  const Tensor offsets = offsets_of_lengths({50, 7, 90});
  const std::vector<Tensor> parts = torch::randn({147, 3, 4, 16}).unbind(1);
  const Tensor found = ragged_attention(parts[0], parts[1], parts[2], offsets, offsets);
  const Tensor dense =
      ragged_attention(parts[0].contiguous(), parts[1].contiguous(), parts[2].contiguous(), offsets, offsets);
  EXPECT_TRUE(torch::equal(found, dense));
  // And with channels that are not adjacent.
  const Tensor across = parts[1].transpose(1, 2).contiguous().transpose(1, 2);
  EXPECT_TRUE(torch::equal(ragged_attention(parts[0], across, parts[2], offsets, offsets), dense));
}

TEST(RaggedAttention, SecondDerivativesAreAnErrorAndNotWrong) {
  const RaggedCase c({2, 4, {20, 3}, {30, 3}});
  const Tensor q = c.q.to(torch::kFloat32).requires_grad_();
  const Tensor out = ragged_attention(q, c.k.to(torch::kFloat32), c.v.to(torch::kFloat32), c.q_offsets, c.k_offsets);
  const Tensor direction = c.direction.to(torch::kFloat32);
  EXPECT_THROW(torch::autograd::grad({out}, {q}, {direction}, /*retain_graph=*/true, /*create_graph=*/true),
               c10::Error);
  EXPECT_TRUE(torch::autograd::grad({out}, {q}, {direction})[0].defined());
}

TEST(RaggedAttention, RejectsWhatDoesNotFit) {
  const Tensor q = torch::zeros({6, 2, 4}), k = torch::zeros({5, 2, 4});
  const Tensor q_offsets = offsets_of_lengths({2, 4}), k_offsets = offsets_of_lengths({3, 2});
  EXPECT_NO_THROW(ragged_attention(q, k, k, q_offsets, k_offsets));
  EXPECT_THROW(ragged_attention(q, k, torch::zeros({4, 2, 4}), q_offsets, k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, torch::zeros({5, 2, 3}), torch::zeros({5, 2, 3}), q_offsets, k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, k.to(torch::kFloat64), k.to(torch::kFloat64), q_offsets, k_offsets), c10::Error);
  const auto offsets = [](std::vector<std::int64_t> values) {
    return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
  };
  EXPECT_THROW(ragged_attention(q, k, k, offsets_of_lengths({6}), k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, k, k, offsets_of_lengths({2, 3}), k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, k, k, offsets({0, 7, 6}), k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, k, k, offsets({1, 2, 6}), k_offsets), c10::Error);
  EXPECT_THROW(ragged_attention(q, k, k, q_offsets.to(torch::kInt32), k_offsets), c10::Error);
}

TEST(RaggedTasks, CoverEveryHeadAndQueryOnceLongestFirst) {
  const RaggedCase c({5, 4, {300, 0, 2, 40, 7}, {900, 3, 2, 40, 0}});
  const RaggedProblem problem(c.q, c.k, c.q_offsets, c.k_offsets);
  const Tensor seen = torch::zeros({5, 349}, torch::kInt64);
  std::int64_t last = std::numeric_limits<std::int64_t>::max();
  for (const RaggedTask& task : ragged_tasks(problem, 128)) {
    EXPECT_LE(task.queries, 128);
    const std::int64_t work = task.heads * task.queries * problem.keys(task.sequence);
    EXPECT_LE(work, last);
    last = work;
    seen.narrow(0, task.first_head, task.heads)
        .narrow(1, problem.q_offsets[task.sequence] + task.first_query, task.queries)
        .add_(1);
  }
  const Tensor wanted = torch::ones({5, 349}, torch::kInt64);
  wanted.narrow(1, 342, 7).zero_();  // queries without keys
  EXPECT_TRUE(torch::equal(seen, wanted));
}

}  // namespace

namespace {

TEST(Ragged, SplitGivesItemsInOrder) {
  const Ragged items({2, 0, 1});
  const std::vector<Tensor> parts = items.split(torch::arange(3));
  ASSERT_EQ(parts.size(), 3U);
  EXPECT_EQ(parts[1].numel(), 0);
  EXPECT_EQ(parts[2][0].item<int>(), 2);
  EXPECT_EQ(items.offset(2), 2);
}

TEST(Ragged, EveryRowKnowsItsItem) {
  const Ragged items({2, 0, 1});
  const Ragged copy = items;
  EXPECT_TRUE(torch::equal(items.item_of_rows(torch::kCPU), torch::tensor({0, 0, 2}, torch::kInt64)));
  EXPECT_EQ(copy.item_of_rows(torch::kCPU).data_ptr(), items.item_of_rows(torch::kCPU).data_ptr()) << "kept once";
  EXPECT_EQ(Ragged({}).item_of_rows(torch::kCPU).numel(), 0);
}

// Plans of the same thread's last calls are kept: one that fits another division of as many rows must not be taken.
TEST(RaggedAttention, DivisionsThatTakeTurnsGiveTheirOwnResults) {
  const RaggedCase one({2, 4, {3, 5, 4}, {2, 2, 6}}), two({2, 4, {5, 3, 4}, {2, 2, 6}}), three({2, 4, {12}, {10}});
  for (int round = 0; round < 3; ++round) {
    for (const RaggedCase* c : {&one, &two, &three, &one})
      expect_close(c->run(tensor_ragged_attention, torch::kFloat64), c->run(attention_per_sequence, torch::kFloat64),
                   1e-11);
  }
}

TEST(Ragged, RowOffsetsEndWithTheNumberOfRows) {
  EXPECT_TRUE(torch::equal(Ragged({2, 0, 1}).row_offsets(), torch::tensor({0, 2, 2, 3}, torch::kInt64)));
  EXPECT_TRUE(torch::equal(Ragged({}).row_offsets(), torch::tensor({0}, torch::kInt64)));
}

}  // namespace

}  // namespace anigen::nn
