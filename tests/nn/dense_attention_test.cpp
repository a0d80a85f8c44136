#include "anigen/nn/attention.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/nn/blocks.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {
namespace {

void fill_doubles(torch::nn::Module& module) {
  torch::manual_seed(21);
  module.to(torch::kFloat64);
  const torch::NoGradGuard no_grad;
  for (Tensor& parameter : module.parameters()) parameter.normal_(0.0, 0.5);
}

Tensor doubles(std::vector<std::int64_t> shape) { return torch::randn(shape, torch::kFloat64); }

double distance(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

Tensor softmax_attention(const Tensor& q, const Tensor& k, const Tensor& v) {  // of one head, [N, D]
  return torch::softmax(q.mm(k.t()) / std::sqrt(static_cast<double>(q.size(1))), 1).mm(v);
}

std::vector<std::string> keys_of(const torch::nn::Module& module) {
  std::vector<std::string> keys;
  for (const auto& entry : module.named_parameters()) keys.push_back(entry.key());
  return keys;
}

AttentionOptions attention_of(std::int64_t channels, std::int64_t heads, std::int64_t context = 0) {
  AttentionOptions options;
  options.channels = channels;
  options.num_heads = heads;
  options.context_channels = context;
  return options;
}

// Each window is a sequence of its own: its tokens alone, in full attention, give what they give inside the grid.
TEST(DenseAttention, WindowsOfAGridAttendAlone) {
  AttentionOptions options = attention_of(6, 2);
  options.qk_rms_norm = true;
  DenseAttention attention(options);
  fill_doubles(*attention);
  constexpr std::int64_t kSide = 5;
  const Tensor x = doubles({2, kSide * kSide * kSide, 6});
  for (const auto& [size, shift] : {std::pair(2, 0), std::pair(2, 1), std::pair(3, 1), std::pair(10, 5)}) {
    const Tensor found = attention->forward_in_windows(x, {kSide, size, shift});
    std::map<std::vector<std::int64_t>, std::vector<std::int64_t>> windows;
    for (std::int64_t i = 0; i < x.size(1); ++i) {
      const std::int64_t place[] = {i / (kSide * kSide), i / kSide % kSide, i % kSide};
      std::vector<std::int64_t> window;
      for (const std::int64_t c : place) window.push_back((c + shift) / size);
      windows[window].push_back(i);
    }
    for (const auto& [window, tokens] : windows) {
      const Tensor rows = torch::tensor(tokens);
      EXPECT_LT(distance(found.index_select(1, rows), attention->forward(x.index_select(1, rows))), 1e-12) << size;
    }
  }
  EXPECT_THROW(attention->forward_in_windows(x, {4, 2, 0}), c10::Error);
}

KERNEL_TEST(DenseAttention, WindowsInEveryPrecision) {
  DenseAttention exact(attention_of(64, 2)), attention(attention_of(64, 2));
  torch::manual_seed(22);
  const torch::NoGradGuard no_grad;
  const Tensor x = torch::randn({2, 216, 64});
  for (const auto& [dtype, tolerance] : {std::pair(torch::kFloat32, 1e-5), std::pair(torch::kBFloat16, 2e-2)}) {
    for (const auto& entry : exact->named_parameters())
      entry.value().copy_(0.2 * torch::randn(entry.value().sizes()).to(torch::kBFloat16));
    attention->to(torch::kFloat32);
    for (auto& entry : attention->named_parameters()) entry.value().copy_(exact->named_parameters()[entry.key()]);
    attention->to(dtype);
    exact->to(torch::kFloat64);
    const Tensor rounded = x.to(dtype);
    const Tensor wanted = exact->forward_in_windows(rounded.to(torch::kFloat64), {6, 4, 2});
    const Tensor found = attention->forward_in_windows(rounded, {6, 4, 2}).to(torch::kFloat64);
    EXPECT_LT(distance(found, wanted), tolerance * wanted.abs().max().item<double>()) << dtype;
  }
}

TEST(AttentionWindows, LiveOnTheirThreadAndShiftEverySecondBlock) {
  EXPECT_EQ(AttentionWindows::size(), 0);
  {
    const AttentionWindows outer(8);
    EXPECT_EQ(AttentionWindows::shift(2), 0);
    EXPECT_EQ(AttentionWindows::shift(3), 4);
    std::int64_t elsewhere = -1;
    std::thread([&] { elsewhere = AttentionWindows::size(); }).join();
    EXPECT_EQ(elsewhere, 0);
    { const AttentionWindows inner(2); }
    EXPECT_EQ(AttentionWindows::size(), 8);
    {
      const AttentionWindows full(0);
      EXPECT_EQ(AttentionWindows::size(), 0);
    }
  }
  EXPECT_EQ(AttentionWindows::size(), 0);
}

TEST(DenseAttention, CrossAttentionWithNormsFollowsTheDefinition) {
  AttentionOptions options = attention_of(6, 2, 5);
  options.qk_rms_norm = true;
  DenseAttention attention(options);
  fill_doubles(*attention);
  const auto p = attention->named_parameters();
  const Tensor x = doubles({2, 4, 6}), context = doubles({2, 7, 5}), found = attention->forward(x, context);
  for (std::int64_t b = 0; b < 2; ++b) {
    const Tensor q = torch::linear(x[b], p["to_q.weight"], p["to_q.bias"]);
    const Tensor kv = torch::linear(context[b], p["to_kv.weight"], p["to_kv.bias"]);
    std::vector<Tensor> heads;
    for (std::int64_t h = 0; h < 2; ++h) {
      const auto normed = [&](const Tensor& rows, const Tensor& gamma) {
        return rows / rows.norm(2, 1, true) * gamma[h] * std::sqrt(3.0);
      };
      heads.push_back(softmax_attention(normed(q.narrow(1, 3 * h, 3), p["q_rms_norm.gamma"]),
                                        normed(kv.narrow(1, 3 * h, 3), p["k_rms_norm.gamma"]),
                                        kv.narrow(1, 6 + 3 * h, 3)));
    }
    const Tensor wanted = torch::linear(torch::cat(heads, 1), p["to_out.weight"], p["to_out.bias"]);
    EXPECT_LT(distance(found[b], wanted), 1e-12) << b;
  }
}

TEST(DenseAttention, InputIsTheQuery) {
  AttentionOptions options = attention_of(4, 1, 3);
  options.x_is_query = true;
  DenseAttention attention(options);
  fill_doubles(*attention);
  const auto p = attention->named_parameters();
  EXPECT_EQ(keys_of(*attention),
            (std::vector<std::string>{"to_kv.weight", "to_kv.bias", "to_out.weight", "to_out.bias"}));
  const Tensor x = doubles({1, 5, 4}), context = doubles({1, 6, 3});
  const Tensor kv = torch::linear(context[0], p["to_kv.weight"], p["to_kv.bias"]);
  const Tensor mixed = softmax_attention(x[0], kv.narrow(1, 0, 4), kv.narrow(1, 4, 4));
  EXPECT_LT(distance(attention->forward(x, context)[0], torch::linear(mixed, p["to_out.weight"], p["to_out.bias"])),
            1e-12);
}

TEST(DenseAttention, RejectsWhatDoesNotFit) {
  EXPECT_THROW(DenseAttention(attention_of(10, 3)), c10::Error);
  AttentionOptions no_context = attention_of(4, 2);
  no_context.x_is_query = true;
  EXPECT_THROW(DenseAttention{no_context}, c10::Error);
  DenseAttention self(attention_of(4, 2)), cross(attention_of(4, 2, 3));
  fill_doubles(*self);
  fill_doubles(*cross);
  EXPECT_THROW(self->forward(doubles({1, 5, 4}), doubles({1, 5, 4})), c10::Error);
  EXPECT_THROW(cross->forward(doubles({1, 5, 4})), c10::Error);
  EXPECT_THROW(cross->forward(doubles({2, 5, 4}), doubles({1, 5, 3})), c10::Error);
  EXPECT_THROW(self->forward(doubles({1, 5, 6})), c10::Error);
}

ModulatedBlockOptions modulated_options() {
  ModulatedBlockOptions options;
  options.channels = 8;
  options.context_channels = 6;
  options.num_heads = 2;
  options.mlp_ratio = 2.0;
  options.qk_rms_norm = true;
  return options;
}

TEST(ModulatedCrossBlock, KeysInPublishedOrder) {
  ModulatedBlockOptions options = modulated_options();
  options.context_norm = true;
  options.lora_cross.rank = 2;
  EXPECT_EQ(keys_of(*ModulatedCrossBlock(options)), (std::vector<std::string>{"norm2.weight",
                                                                              "norm2.bias",
                                                                              "context_norm.weight",
                                                                              "context_norm.bias",
                                                                              "self_attn.to_qkv.weight",
                                                                              "self_attn.to_qkv.bias",
                                                                              "self_attn.q_rms_norm.gamma",
                                                                              "self_attn.k_rms_norm.gamma",
                                                                              "self_attn.to_out.weight",
                                                                              "self_attn.to_out.bias",
                                                                              "cross_attn.to_q.weight",
                                                                              "cross_attn.to_q.bias",
                                                                              "cross_attn.to_q.lora_A",
                                                                              "cross_attn.to_q.lora_B",
                                                                              "cross_attn.to_kv.weight",
                                                                              "cross_attn.to_kv.bias",
                                                                              "cross_attn.to_kv.lora_A",
                                                                              "cross_attn.to_kv.lora_B",
                                                                              "cross_attn.to_out.weight",
                                                                              "cross_attn.to_out.bias",
                                                                              "cross_attn.to_out.lora_A",
                                                                              "cross_attn.to_out.lora_B",
                                                                              "mlp.mlp.0.weight",
                                                                              "mlp.mlp.0.bias",
                                                                              "mlp.mlp.2.weight",
                                                                              "mlp.mlp.2.bias",
                                                                              "adaLN_modulation.1.weight",
                                                                              "adaLN_modulation.1.bias"}));
}

TEST(ModulatedCrossBlock, ZeroModulationLeavesOnlyTheCrossAttention) {
  ModulatedCrossBlock block(modulated_options());
  fill_doubles(*block);
  {
    const torch::NoGradGuard no_grad;
    for (Tensor& parameter : block->modulation()->parameters()) parameter.zero_();
    block->named_parameters()["cross_attn.to_out.weight"].zero_();
  }
  const Tensor x = doubles({2, 5, 8});
  const Tensor wanted = x + block->named_parameters()["cross_attn.to_out.bias"];
  EXPECT_LT(distance(block->forward(x, doubles({2, 8}), doubles({2, 3, 6})), wanted), 1e-14);
}

TEST(ModulatedCrossBlock, SharedModulationIsTheBlocksOwnFormedOutside) {
  ModulatedBlockOptions options = modulated_options();
  ModulatedCrossBlock own(options);
  options.share_mod = true;
  ModulatedCrossBlock shared(options);
  EXPECT_TRUE(shared->modulation().is_empty());
  fill_doubles(*own);
  fill_doubles(*shared);
  auto parameters = own->named_parameters();
  {
    const torch::NoGradGuard no_grad;
    for (auto& entry : shared->named_parameters()) entry.value().copy_(parameters[entry.key()]);
  }
  const Tensor x = doubles({2, 5, 8}), mod = doubles({2, 8}), context = doubles({2, 3, 6});
  const Tensor six = own->modulation()->forward(torch::silu(mod));
  EXPECT_LT(distance(shared->forward(x, six, context), own->forward(x, mod, context)), 1e-14);
  EXPECT_THROW(shared->forward(x, mod, context), c10::Error);
}

TEST(ModulatedCrossBlock, GradientMatchesFiniteDifferences) {
  ModulatedCrossBlock block(modulated_options());
  fill_doubles(*block);
  const std::vector<Tensor> inputs = {doubles({2, 3, 8}).requires_grad_(), doubles({2, 8}).requires_grad_(),
                                      doubles({2, 4, 6}).requires_grad_()};
  const Tensor direction = doubles({2, 3, 8});
  const auto loss = [&](const Tensor& x, const Tensor& mod, const Tensor& context) {
    return (block->forward(x, mod, context) * direction).sum();
  };
  const auto gradients = torch::autograd::grad({loss(inputs[0], inputs[1], inputs[2])}, inputs);
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> steps;
  double found = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    steps.push_back(torch::randn_like(inputs[i]));
    found += (gradients[i] * steps[i]).sum().item<double>();
  }
  const auto at_step = [&](double h) {
    return loss(inputs[0] + h * steps[0], inputs[1] + h * steps[1], inputs[2] + h * steps[2]).item<double>();
  };
  const double h = 1e-5, slope = (at_step(h) - at_step(-h)) / (2 * h);
  EXPECT_NEAR(found, slope, 1e-5 * (1.0 + std::abs(slope)));
}

TEST(DenseBlock, AnotherWidthGoesThroughResMlp) {
  DenseBlockOptions options;
  options.channels = 6;
  options.out_channels = 4;
  options.num_heads = 2;
  DenseBlock block(options);
  fill_doubles(*block);
  EXPECT_EQ(block->named_parameters()["res_mlp.mlp.0.weight"].sizes(), (std::vector<std::int64_t>{6, 6}));
  EXPECT_EQ(block->forward(doubles({2, 3, 6})).sizes(), (std::vector<std::int64_t>{2, 3, 4}));
}

TEST(DenseCrossBlock, WithoutSelfAttentionHasNeitherItsNormNorItsLayers) {
  DenseBlockOptions options;
  options.channels = 6;
  options.context_channels = 5;
  options.affine_norms = true;
  options.self_attention = false;
  for (const std::string& key : keys_of(*DenseCrossBlock(options)))
    EXPECT_TRUE(key.rfind("norm1", 0) != 0 && key.rfind("self_attn", 0) != 0) << key;
}

}  // namespace
}  // namespace anigen::nn
