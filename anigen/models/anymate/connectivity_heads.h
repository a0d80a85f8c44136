#pragma once
#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/connectivity.h"
#include "anigen/models/anymate/head_options.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// "attendjoints_con_combine" (reference anymate-baselines.md, 4.1): joints become child tokens in one branch and
/// parent tokens in another; branches share their attention to the latents and have their own among joints. Masked
/// columns get -1e8. Keys `co_proj`, `cross_attn.<j>.*`, `self_attn.<layers · branch + j>.*`, `q_proj`, `k_proj`,
/// `ln_1`, `ln_2`.
class TwoBranchConnectivityImpl : public ConnectivityImpl {
 public:
  explicit TwoBranchConnectivityImpl(const HeadOptions& options = {}, std::int64_t layers = 2,
                                     nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) override;

 private:
  HeadOptions options_;
  nn::Linear co_proj_ = nullptr, q_proj_ = nullptr, k_proj_ = nullptr;
  std::vector<ResidualCrossAttention> cross_attn_;
  std::vector<ResidualAttention> self_attn_;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr;
};
TORCH_MODULE(TwoBranchConnectivity);

/// Three linear maps in a row, without anything between them, and a layer norm, as released. Keys `0.*` … `3.*`.
class LinearChainImpl : public torch::nn::Module {
 public:
  LinearChainImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x);

 private:
  nn::Linear first_ = nullptr, second_ = nullptr, third_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(LinearChain);

/// "attendjoints_con_token" (reference anymate-baselines.md, 4.2): joints and latents through one transformer; a
/// learned token beside each joint says whether it is meant as a child or as a parent. Masked joints are hidden from
/// the attention only: their columns keep their logits. Keys `head_token`, `tail_token` [1, 1, T], `layer_norm`,
/// `head_mlp.{0..3}`, `tail_mlp.{0..3}`, `self_attn.resblocks.<i>.*`, `joints_proj`, `output_proj_joints`.
class TokenConnectivityImpl : public ConnectivityImpl {
 public:
  explicit TokenConnectivityImpl(const HeadOptions& options = {}, std::int64_t layers = 4,
                                 std::int64_t token_length = 128, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) override;

 private:
  HeadOptions options_;
  Tensor head_token_, tail_token_;
  nn::AffineLayerNorm layer_norm_ = nullptr;
  LinearChain head_mlp_ = nullptr, tail_mlp_ = nullptr;
  ResidualStack self_attn_ = nullptr;
  nn::Linear joints_proj_ = nullptr, output_proj_joints_ = nullptr;
};
TORCH_MODULE(TokenConnectivity);

}  // namespace anigen::models::anymate
