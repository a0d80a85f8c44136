#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <cmath>
#include <functional>
#include <limits>
#include <ostream>
#include <utility>
#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/kernels/attention_fp32.h"
#include "tests/nn/attention_results.h"
#include "tests/nn/largest_difference.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {

namespace {

constexpr double kTolerance = 1e-12;  // double precision throughout

void to_random_double(torch::nn::Module& module) {
  torch::manual_seed(7);
  module.to(torch::kFloat64);
  const torch::NoGradGuard no_grad;
  for (Tensor& parameter : module.parameters()) parameter.normal_(0.0, 0.5);
}

Tensor random(std::vector<std::int64_t> shape) { return torch::randn(shape, torch::kFloat64); }

AttentionOptions options(std::int64_t channels, std::int64_t heads, std::int64_t context = 0) {
  AttentionOptions options;
  options.channels = channels;
  options.num_heads = heads;
  options.context_channels = context;
  return options;
}

// Head by head, from the definition: head h owns channels h·d … of q, k and v.
Tensor attention_by_definition(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t heads) {
  const std::int64_t width = q.size(1) / heads;
  std::vector<Tensor> parts;
  for (std::int64_t h = 0; h < heads; ++h) {
    const Tensor scores =
        q.narrow(1, h * width, width).mm(k.narrow(1, h * width, width).t()) / std::sqrt(static_cast<double>(width));
    parts.push_back(torch::softmax(scores, 1).mm(v.narrow(1, h * width, width)));
  }
  return torch::cat(parts, 1);
}

TEST(SelfAttention, FollowsTheDefinition) {
  RaggedAttention attention(options(12, 3));
  to_random_double(*attention);
  const auto parameters = attention->named_parameters();
  const Tensor x = random({5, 12});
  const Tensor qkv = torch::linear(x, parameters["to_qkv.weight"], parameters["to_qkv.bias"]);
  const Tensor mixed = attention_by_definition(qkv.narrow(1, 0, 12), qkv.narrow(1, 12, 12), qkv.narrow(1, 24, 12), 3);
  const Tensor wanted = torch::linear(mixed, parameters["to_out.weight"], parameters["to_out.bias"]);
  EXPECT_LT(largest_difference(attention->forward(x, Ragged({5})), wanted), kTolerance);
}

// Item by item gives what the batch gives, whether padded (similar lengths) or looped (one long item).
void expect_batch_equals_items(const std::vector<std::int64_t>& lengths) {
  RaggedAttention attention(options(8, 2));
  to_random_double(*attention);
  const Ragged items(lengths);
  const Tensor x = random({items.rows(), 8});
  std::vector<Tensor> one_by_one;
  for (const Tensor& item : items.split(x)) one_by_one.push_back(attention->forward(item, Ragged({item.size(0)})));
  EXPECT_LT(largest_difference(attention->forward(x, items), torch::cat(one_by_one, 0)), kTolerance);
}

TEST(SelfAttention, PaddedBatchEqualsItems) { expect_batch_equals_items({3, 7, 1, 5}); }
TEST(SelfAttention, LoopedBatchEqualsItems) { expect_batch_equals_items({200, 3, 1}); }

TEST(SelfAttention, PaddingReceivesNoGradient) {
  RaggedAttention attention(options(4, 2));
  to_random_double(*attention);
  const Ragged items({2, 5});
  Tensor x = random({7, 4}).requires_grad_();
  attention->forward(x, items).square().sum().backward();
  Tensor alone = x.detach().narrow(0, 0, 2).clone().requires_grad_();
  attention->forward(alone, Ragged({2})).square().sum().backward();
  EXPECT_LT(largest_difference(x.grad().narrow(0, 0, 2), alone.grad()), kTolerance);
}

TEST(CrossAttention, FollowsTheDefinitionPerItem) {
  RaggedAttention attention(options(6, 2, 4));
  to_random_double(*attention);
  const auto parameters = attention->named_parameters();
  const Tensor x = random({5, 6}), context = random({7, 4});
  const Tensor q = torch::linear(x, parameters["to_q.weight"], parameters["to_q.bias"]);
  const Tensor kv = torch::linear(context, parameters["to_kv.weight"], parameters["to_kv.bias"]);
  const auto item = [&](std::int64_t x0, std::int64_t n, std::int64_t c0, std::int64_t m) {
    const Tensor rows = kv.narrow(0, c0, m);
    return attention_by_definition(q.narrow(0, x0, n), rows.narrow(1, 0, 6), rows.narrow(1, 6, 6), 2);
  };
  const Tensor mixed = torch::cat({item(0, 2, 0, 4), item(2, 3, 4, 3)}, 0);
  const Tensor wanted = torch::linear(mixed, parameters["to_out.weight"], parameters["to_out.bias"]);
  EXPECT_LT(largest_difference(attention->forward(x, Ragged({2, 3}), context, Ragged({4, 3})), wanted), kTolerance);
}

TEST(TransformerBlock, GradientMatchesFiniteDifferences) {
  TransformerBlock block(8, 2, 2.0);
  to_random_double(*block);
  const Ragged items({2, 3});
  Tensor x = random({5, 8}).requires_grad_();
  const Tensor direction = random({5, 8});
  const auto loss = [&](const Tensor& at) { return (block->forward(at, items) * direction).sum(); };
  loss(x).backward();
  const torch::NoGradGuard no_grad;
  const Tensor step = random({5, 8});
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-16 / h
  const double slope = (loss(x + h * step) - loss(x - h * step)).item<double>() / (2 * h);
  EXPECT_NEAR((x.grad() * step).sum().item<double>(), slope, 1e-6 * (1.0 + std::abs(slope)));
}

TEST(CastLinears, ConvertsLinearsAndKeepsBareParameters) {
  struct ModelImpl : torch::nn::Module {
    ModelImpl() {
      bare = register_parameter("bare", torch::zeros({2}));
      linear = register_module("linear", Linear(2, 3));
    }
    Tensor bare;
    Linear linear = nullptr;
  };
  ModelImpl model;
  cast_linears(model, torch::kHalf);
  EXPECT_EQ(model.bare.scalar_type(), torch::kFloat32);
  EXPECT_EQ(model.linear->weight.scalar_type(), torch::kHalf);
  EXPECT_EQ(model.linear->bias.scalar_type(), torch::kHalf);
}

TEST(XavierUniform, FillsTheDocumentedRange) {
  torch::manual_seed(1);
  Linear linear(30, 20);
  xavier_uniform_linears(*linear);
  const double bound = std::sqrt(6.0 / 50.0);
  const double largest = linear->weight.abs().max().item<double>();
  EXPECT_LE(largest, bound);
  EXPECT_GT(largest, 0.95 * bound);  // 600 draws: the chance of missing the outer 5 % is 1e-13
  EXPECT_EQ(linear->bias.abs().max().item<double>(), 0.0);
}

}  // namespace

namespace {

using test::expect_close;
using test::share_of_difference;

using Attention = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

Tensor plain_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  const double scale = 1.0 / std::sqrt(static_cast<double>(q.size(-1)));
  return torch::softmax(torch::matmul(q, k.transpose(-2, -1)) * scale, -1).matmul(v);
}

Tensor in_blocks_of_five(const Tensor& q, const Tensor& k, const Tensor& v) {
  return tensor_blocked_attention(q, k, v, 5);
}

struct AttentionSizes {
  std::int64_t batch, heads, queries, keys, channels;
};
std::ostream& operator<<(std::ostream& out, const AttentionSizes& s) {
  return out << s.batch << "x" << s.heads << " heads, " << s.queries << " queries, " << s.keys << " keys, "
             << s.channels << " channels";
}

// Queries, keys, values and a direction for the gradient, fp64; scores of a few units, so that weights differ.
struct AttentionCase {
  explicit AttentionCase(const AttentionSizes& s) {
    torch::manual_seed(11);
    const auto random = [&](std::int64_t rows) {
      return torch::randn({s.batch, s.heads, rows, s.channels}, torch::kFloat64);
    };
    q = 2.0 * random(s.queries);
    k = random(s.keys);
    v = random(s.keys);
    direction = random(s.queries);
  }
  Tensor q, k, v, direction;

  test::AttentionResults run(const Attention& attention, torch::Dtype dtype) const {
    std::vector<Tensor> inputs;
    for (const Tensor& x : {q, k, v}) inputs.push_back(x.to(dtype).detach().clone().requires_grad_());
    const Tensor out = attention(inputs[0], inputs[1], inputs[2]);
    return {out.detach(), torch::autograd::grad({out}, inputs, {direction.to(dtype)})};
  }
};

class BlockedAttentionSizes : public testing::TestWithParam<AttentionSizes> {};

TEST_P(BlockedAttentionSizes, CpuVersionAgreesWithTheFormula) {
  const AttentionCase c(GetParam());
  // fp32 sums of up to some thousand terms of size one: a few times 1e-6 of the largest value.
  const auto wanted = c.run(plain_attention, torch::kFloat64);
  test::in_every_kernel_form([&] { expect_close(c.run(cpu_blocked_attention, torch::kFloat32), wanted, 2e-5); });
}

TEST_P(BlockedAttentionSizes, TensorVersionAgreesWithTheFormula) {
  const AttentionCase c(GetParam());
  expect_close(c.run(in_blocks_of_five, torch::kFloat64), c.run(plain_attention, torch::kFloat64), 1e-11);
}

TEST_P(BlockedAttentionSizes, ChosenVersionAgreesWithTheFormula) {
  const AttentionCase c(GetParam());
  const auto wanted = c.run(plain_attention, torch::kFloat64);
  expect_close(c.run(blocked_attention, torch::kFloat32), wanted, 2e-5);
  expect_close(c.run(blocked_attention, torch::kFloat64), wanted, 1e-11);
}

// One of everything; a single key; blocks of 128 queries and 512 keys filled exactly, and not.
INSTANTIATE_TEST_SUITE_P(Sizes, BlockedAttentionSizes,
                         testing::Values(AttentionSizes{1, 1, 1, 1, 1}, AttentionSizes{2, 3, 17, 1, 4},
                                         AttentionSizes{1, 2, 128, 512, 8}, AttentionSizes{2, 2, 131, 517, 5},
                                         AttentionSizes{1, 1, 300, 1100, 3}, AttentionSizes{1, 3, 1, 700, 16}));

TEST(BlockedAttention, GradientMatchesFiniteDifferences) {
  const AttentionCase c({1, 2, 13, 9, 4});
  const auto loss = [&](const Tensor& q, const Tensor& k, const Tensor& v) {
    return (in_blocks_of_five(q, k, v) * c.direction).sum().item<double>();
  };
  const std::vector<Tensor> gradients = c.run(in_blocks_of_five, torch::kFloat64).gradients;
  const Tensor dq = torch::randn_like(c.q), dk = torch::randn_like(c.k), dv = torch::randn_like(c.v);
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-15 / h
  const double slope =
      (loss(c.q + h * dq, c.k + h * dk, c.v + h * dv) - loss(c.q - h * dq, c.k - h * dk, c.v - h * dv)) / (2 * h);
  const Tensor found = (gradients[0] * dq).sum() + (gradients[1] * dk).sum() + (gradients[2] * dv).sum();
  EXPECT_NEAR(found.item<double>(), slope, 1e-6 * (1.0 + std::abs(slope)));
}

KERNEL_TEST(BlockedAttention, LargeScoresDoNotOverflow) {
  AttentionCase c({1, 1, 40, 1030, 8});
  c.q = c.q * 30.0;  // scores of some hundreds: nearly all weight on one key, which may be in any block of keys
  // Rounding moves scores of 200 by 2e-5, and weights by as large a share.
  expect_close(c.run(cpu_blocked_attention, torch::kFloat32), c.run(plain_attention, torch::kFloat64), 1e-3);
}

KERNEL_TEST(BlockedAttention, NotFiniteScoresAreSeen) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    const AttentionCase c({1, 1, 4, 600, 8});
    Tensor q = c.q.to(torch::kFloat32), k = c.k.to(torch::kFloat32).abs();
    q[0][0][2].fill_(bad);
    const Tensor out = cpu_blocked_attention(q, k, c.v.to(torch::kFloat32));
    EXPECT_TRUE(out[0][0][2].isnan().all().item<bool>()) << bad;
    EXPECT_TRUE(out[0][0][1].isfinite().all().item<bool>()) << bad;
  }
}

KERNEL_TEST(BlockedAttention, StridedInputsGiveTheSame) {
  // As a projection leaves them: q, k and v side by side in each row.
  torch::manual_seed(12);
  const Tensor qkv = torch::randn({2, 150, 3, 2, 16});
  const std::vector<Tensor> parts = qkv.permute({2, 0, 3, 1, 4}).unbind(0);
  const Tensor found = cpu_blocked_attention(parts[0], parts[1], parts[2]);
  const Tensor dense = cpu_blocked_attention(parts[0].contiguous(), parts[1].contiguous(), parts[2].contiguous());
  EXPECT_LT(share_of_difference(found, dense), 1e-6);
  // And with channels that are not adjacent.
  const Tensor across = parts[1].transpose(-2, -1).contiguous().transpose(-2, -1);
  EXPECT_LT(share_of_difference(cpu_blocked_attention(parts[0], across, parts[2]), dense), 1e-6);
}

KERNEL_TEST(BlockedAttention, SixteenBitInputs) {
  const AttentionCase c({1, 2, 140, 530, 16});
  for (const auto& [dtype, digits] : {std::pair(torch::kBFloat16, 8), std::pair(torch::kHalf, 11)}) {
    // The inputs are rounded first, so that only our own rounding counts: of the result, and of what is saved.
    AttentionCase rounded = c;
    for (Tensor* x : {&rounded.q, &rounded.k, &rounded.v, &rounded.direction}) *x = x->to(dtype).to(torch::kFloat64);
    const auto found = rounded.run(blocked_attention, dtype);
    EXPECT_EQ(found.out.scalar_type(), dtype);
    expect_close(found, rounded.run(plain_attention, torch::kFloat64), 4.0 * std::exp2(-digits));
  }
}

// Whole panels of 64 keys and last ones of 16, 32 and 48, blocks of 256 and 96 queries, and not; every size of head
// that the kernels for bf16 know, and one that they do not. All forms but the widest go through fp32.
KERNEL_TEST(BlockedAttention, Bf16OfAllSizes) {
  for (const AttentionSizes& sizes :
       {AttentionSizes{2, 2, 96, 256, 16}, AttentionSizes{1, 3, 97, 1, 32}, AttentionSizes{1, 2, 192, 320, 48},
        AttentionSizes{2, 1, 5, 777, 64}, AttentionSizes{1, 2, 100, 65, 64}, AttentionSizes{1, 1, 13, 40, 64},
        AttentionSizes{1, 2, 7, 90, 32}, AttentionSizes{1, 1, 130, 600, 40}}) {
    SCOPED_TRACE(testing::Message() << sizes);
    AttentionCase rounded(sizes);
    for (Tensor* x : {&rounded.q, &rounded.k, &rounded.v, &rounded.direction})
      *x = x->to(torch::kBFloat16).to(torch::kFloat64);
    const auto wanted = rounded.run(plain_attention, torch::kFloat64);
    expect_close(rounded.run(cpu_blocked_attention, torch::kBFloat16), wanted, std::exp2(-6));
    // As a projection leaves them, side by side, the queries only when there are as many.
    const Tensor kv = torch::stack({rounded.k, rounded.v}, 3).to(torch::kBFloat16).transpose(1, 2).contiguous();
    const std::vector<Tensor> parts = kv.transpose(1, 2).unbind(3);
    const Tensor q = rounded.q.to(torch::kBFloat16);
    EXPECT_TRUE(torch::equal(cpu_blocked_attention(q, parts[0], parts[1]),
                             cpu_blocked_attention(q, parts[0].contiguous(), parts[1].contiguous())));
  }
}

KERNEL_TEST(BlockedAttention, Bf16LargeAndNotFiniteScores) {
  AttentionCase c({1, 1, 40, 1030, 64});
  const Tensor k = c.k.to(torch::kBFloat16), v = c.v.to(torch::kBFloat16);
  Tensor q = (30.0 * c.q).to(torch::kBFloat16);  // scores of some hundreds
  const auto as_double = [](const Tensor& x) { return x.to(torch::kFloat64); };
  EXPECT_LT(
      share_of_difference(cpu_blocked_attention(q, k, v), plain_attention(as_double(q), as_double(k), as_double(v))),
      std::exp2(-6));
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    q[0][0][7].fill_(bad);
    const Tensor out = cpu_blocked_attention(q, k.abs(), v);
    EXPECT_TRUE(out[0][0][7].isnan().all().item<bool>()) << bad;
    EXPECT_TRUE(out[0][0][6].isfinite().all().item<bool>()) << bad;
  }
}

// Sums of 16 to 700 terms: another number of threads may round them otherwise, by 1e-5 of the largest value; the same
// number gives the same bits.
KERNEL_TEST(BlockedAttention, DependsOnTheNumberOfThreadsByRoundingOnly) {
  const int before = at::get_num_threads();
  for (const std::int64_t heads : {1, 2, 6}) {
    const AttentionCase c({1, heads, 300, 700, 16});
    at::set_num_threads(1);
    const auto one = c.run(cpu_blocked_attention, torch::kFloat32);
    for (const int threads : {1, 2, 3}) {
      at::set_num_threads(threads);
      const auto first = c.run(cpu_blocked_attention, torch::kFloat32);
      const auto second = c.run(cpu_blocked_attention, torch::kFloat32);
      expect_close(first, one, 1e-5);
      EXPECT_TRUE(torch::equal(first.out, second.out)) << threads << " threads, " << heads << " heads";
      for (std::size_t g = 0; g < 3; ++g) EXPECT_TRUE(torch::equal(first.gradients[g], second.gradients[g]));
    }
  }
  at::set_num_threads(before);
}

TEST(BlockedAttention, SecondDerivativesAreAnErrorAndNotWrong) {
  const AttentionCase c({1, 2, 20, 30, 4});
  const Attention versions[] = {cpu_blocked_attention, in_blocks_of_five};
  for (const Attention& attention : versions) {
    const Tensor q = c.q.to(torch::kFloat32).requires_grad_();
    const Tensor out = attention(q, c.k.to(torch::kFloat32), c.v.to(torch::kFloat32));
    const Tensor direction = c.direction.to(torch::kFloat32);
    EXPECT_THROW(torch::autograd::grad({out}, {q}, {direction}, /*retain_graph=*/true, /*create_graph=*/true),
                 c10::Error);
    EXPECT_TRUE(torch::autograd::grad({out}, {q}, {direction})[0].defined());
  }
}

TEST(BlockedAttention, ScratchIsBounded) {
  constexpr std::int64_t kMiB = 1 << 20;
  EXPECT_LE(blocked_attention_scratch_bytes(4096, 4096, 64), kMiB);
  EXPECT_LE(blocked_attention_scratch_bytes(1 << 20, 1 << 20, 64), kMiB);
  EXPECT_LE(blocked_attention_scratch_bytes(1 << 20, 1, 64), kMiB);
  // Never more than twice the scores themselves and one row of results per query.
  EXPECT_LE(blocked_attention_scratch_bytes(10, 20, 4), 4 * (2 * 10 * 20 + 10 * (4 + 3)));
}

TEST(BlockedAttention, RejectsShapesThatDoNotFit) {
  const Tensor q = torch::zeros({2, 3, 4, 8});
  EXPECT_THROW(blocked_attention(q, torch::zeros({2, 3, 5, 6}), torch::zeros({2, 3, 5, 6})), c10::Error);
  EXPECT_THROW(blocked_attention(q, torch::zeros({2, 3, 5, 8}), torch::zeros({2, 3, 4, 8})), c10::Error);
  EXPECT_THROW(blocked_attention(q, torch::zeros({2, 3, 0, 8}), torch::zeros({2, 3, 0, 8})), c10::Error);
  const Tensor doubles = torch::zeros({2, 3, 5, 8}, torch::kFloat64);
  EXPECT_THROW(blocked_attention(q, doubles, doubles), c10::Error);
}

}  // namespace

}  // namespace anigen::nn
