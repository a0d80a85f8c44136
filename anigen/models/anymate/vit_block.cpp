#include "anigen/models/anymate/vit_block.h"

#include <string>
#include <vector>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kVitMlpRatio = 4;

}  // namespace

VitAttentionImpl::VitAttentionImpl(std::int64_t width, std::int64_t heads) : heads_(heads) {
  require(width > 0 && heads > 0 && width % heads == 0, "num_heads",
          std::to_string(heads) + " heads do not divide a width of " + std::to_string(width));
  qkv_ = register_module("qkv", nn::Linear(width, 3 * width, /*with_bias=*/false));
  proj_ = register_module("proj", nn::Linear(width, width));
}

Tensor VitAttentionImpl::forward(const Tensor& x) {
  const Tensor qkv = qkv_(x).view({x.size(0), x.size(1), 3, heads_, x.size(2) / heads_});
  const std::vector<Tensor> parts = qkv.permute({2, 0, 3, 1, 4}).unbind(0);  // [B, H, N, d] each
  return proj_(masked_attention(parts[0], parts[1], parts[2]).transpose(1, 2).flatten(2));
}

VitBlockImpl::VitBlockImpl(std::int64_t width, std::int64_t heads, double drop_path) : drop_path_(drop_path) {
  require(drop_path >= 0.0 && drop_path < 1.0, "drop_path_rate", "must be in [0, 1)");
  norm1_ = register_module("norm1", nn::AffineLayerNorm(width, kNormEps));
  norm2_ = register_module("norm2", nn::AffineLayerNorm(width, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kVitMlpRatio * width, width, "fc1", "fc2"));
  attention_ = register_module("attn", VitAttention(width, heads));
}

Tensor VitBlockImpl::kept(const Tensor& branch) const {
  if (!is_training() || drop_path_ == 0.0) return branch;
  const double keep = 1.0 - drop_path_;
  return branch * torch::bernoulli(torch::full({branch.size(0), 1, 1}, keep, branch.options())).div_(keep);
}

Tensor VitBlockImpl::forward(const Tensor& x) {
  const Tensor attended = x + kept(attention_(norm1_(x)));
  return attended + kept(mlp_(norm2_(attended)));
}

}  // namespace anigen::models::anymate
