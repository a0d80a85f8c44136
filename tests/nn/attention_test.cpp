#include "anigen/nn/attention.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/nn/init.h"
#include "anigen/nn/transformer_block.h"
#include "tests/nn/largest_difference.h"

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
  SelfAttention attention(options(12, 3));
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
  SelfAttention attention(options(8, 2));
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
  SelfAttention attention(options(4, 2));
  to_random_double(*attention);
  const Ragged items({2, 5});
  Tensor x = random({7, 4}).requires_grad_();
  attention->forward(x, items).square().sum().backward();
  Tensor alone = x.detach().narrow(0, 0, 2).clone().requires_grad_();
  attention->forward(alone, Ragged({2})).square().sum().backward();
  EXPECT_LT(largest_difference(x.grad().narrow(0, 0, 2), alone.grad()), kTolerance);
}

TEST(CrossAttention, FollowsTheDefinitionPerItem) {
  CrossAttention attention(options(6, 2, 4));
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
}  // namespace anigen::nn
