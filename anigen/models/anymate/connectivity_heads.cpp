#include "anigen/models/anymate/connectivity_heads.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/embedders.h"
#include "anigen/models/anymate/init.h"
#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

constexpr double kMaskedParent = -1e8;
constexpr std::size_t kBranches = 2;
constexpr std::int64_t kChainWidth = 512;
constexpr double kRoleTokenDeviation = 0.02;

// The joints that a mask speaks of, [B, J, 3]; all without one.
Tensor masked_joints(const Tensor& latents, const Tensor& joints, const Tensor& mask, std::int64_t width) {
  require_shape(latents, {-1, -1, width}, "latents");
  require_shape(joints, {latents.size(0), -1, 3}, "joints");
  if (!mask.defined()) return joints;
  require_shape(mask, {joints.size(0), -1}, "joints_mask");
  require(mask.size(1) <= joints.size(1), "joints_mask", "is for more joints than there are");
  return joints.narrow(1, 0, mask.size(1));
}

}  // namespace

TwoBranchConnectivityImpl::TwoBranchConnectivityImpl(const HeadOptions& options, std::int64_t layers, nn::Init init)
    : options_(options) {
  require(layers > 0, "layers", "must be positive");
  const std::int64_t width = options.width;
  co_proj_ = register_module("co_proj", nn::Linear(fourier_width(options.num_freqs), width));
  for (std::int64_t j = 0; j < layers; ++j) cross_attn_.emplace_back(width, options.heads, options.qkv_bias);
  for (std::size_t j = 0; j < kBranches * cross_attn_.size(); ++j)
    self_attn_.emplace_back(width, options.heads, options.qkv_bias);
  register_module("cross_attn", nn::module_list(cross_attn_));
  register_module("self_attn", nn::module_list(self_attn_));
  q_proj_ = register_module("q_proj", nn::Linear(width, width));
  k_proj_ = register_module("k_proj", nn::Linear(width, width));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(width, kNormEps));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
}

Tensor TwoBranchConnectivityImpl::forward(const Tensor& latents, const Tensor& joints, const Tensor& mask) {
  const Tensor positions = masked_joints(latents, joints, mask, options_.width);
  const KeyMask keys = mask.defined() ? KeyMask(mask) : KeyMask();
  const Tensor embedded = co_proj_(fourier_features(positions, options_.num_freqs, /*include_pi=*/true));
  std::vector<Tensor> branches;
  for (std::size_t branch = 0; branch < kBranches; ++branch) {
    Tensor x = embedded;
    for (std::size_t j = 0; j < cross_attn_.size(); ++j) {
      x = cross_attn_[j](x, latents);
      x = self_attn_[branch * cross_attn_.size() + j](x, keys);
    }
    branches.push_back(x);
  }
  const Tensor children = k_proj_(ln_1_(branches[0])), parents = q_proj_(ln_2_(branches[1]));
  const Tensor logits = torch::matmul(children, parents.transpose(1, 2));
  return mask.defined() ? logits.masked_fill((mask == 0).unsqueeze(1), kMaskedParent) : logits;
}

LinearChainImpl::LinearChainImpl(std::int64_t in, std::int64_t out) {
  first_ = register_module("0", nn::Linear(in, kChainWidth));
  second_ = register_module("1", nn::Linear(kChainWidth, kChainWidth));
  third_ = register_module("2", nn::Linear(kChainWidth, out));
  norm_ = register_module("3", nn::AffineLayerNorm(out, kNormEps));
}

Tensor LinearChainImpl::forward(const Tensor& x) { return norm_(third_(second_(first_(x)))); }

TokenConnectivityImpl::TokenConnectivityImpl(const HeadOptions& options, std::int64_t layers, std::int64_t token_length,
                                             nn::Init init)
    : options_(options) {
  const std::int64_t width = options.width;
  head_token_ = register_parameter("head_token", torch::empty({1, 1, token_length}));
  tail_token_ = register_parameter("tail_token", torch::empty({1, 1, token_length}));
  layer_norm_ = register_module("layer_norm", nn::AffineLayerNorm(width, kNormEps));
  head_mlp_ = register_module("head_mlp", LinearChain(width + token_length, width));
  tail_mlp_ = register_module("tail_mlp", LinearChain(width + token_length, width));
  self_attn_ = register_module("self_attn", ResidualStack(layers, width, options.heads, options.qkv_bias));
  joints_proj_ = register_module("joints_proj", nn::Linear(fourier_width(options.num_freqs), width));
  output_proj_joints_ = register_module("output_proj_joints", nn::Linear(width, width));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
  torch::nn::init::normal_(head_token_, 0.0, kRoleTokenDeviation);
  torch::nn::init::normal_(tail_token_, 0.0, kRoleTokenDeviation);
}

Tensor TokenConnectivityImpl::forward(const Tensor& latents, const Tensor& joints, const Tensor& mask) {
  const Tensor positions = masked_joints(latents, joints, mask, options_.width);
  KeyMask keys;
  if (mask.defined()) {
    const Tensor latents_count = torch::ones({latents.size(0), latents.size(1)}, mask.options());
    keys = KeyMask(torch::cat({mask, latents_count}, 1));
  }
  const Tensor embedded = joints_proj_(fourier_features(positions, options_.num_freqs, /*include_pi=*/true));
  const Tensor all = self_attn_(torch::cat({embedded, latents}, 1), keys);
  const Tensor found = output_proj_joints_(layer_norm_(all.slice(1, 0, positions.size(1))));
  const auto in_role = [&](LinearChain& chain, const Tensor& token) {
    return chain(torch::cat({found, token.expand({found.size(0), found.size(1), -1})}, -1));
  };
  return torch::matmul(in_role(head_mlp_, head_token_), in_role(tail_mlp_, tail_token_).transpose(1, 2));
}

}  // namespace anigen::models::anymate
