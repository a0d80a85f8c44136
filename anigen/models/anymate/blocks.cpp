#include "anigen/models/anymate/blocks.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kMlpRatio = 4;

}  // namespace

ErfMlpImpl::ErfMlpImpl(std::int64_t in, std::int64_t hidden, std::int64_t out, const std::string& first,
                       const std::string& second) {
  first_ = register_module(first, nn::Linear(in, hidden));
  second_ = register_module(second, nn::Linear(hidden, out));
}

Tensor ErfMlpImpl::forward(const Tensor& x) { return second_(torch::gelu(first_(x))); }

ResidualAttentionImpl::ResidualAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias) {
  attention_ = register_module("attn", InterleavedSelfAttention(width, heads, qkv_bias));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kMlpRatio * width, width));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(width, kNormEps));
}

Tensor ResidualAttentionImpl::forward(const Tensor& x, const KeyMask& mask) {
  const Tensor attended = x + attention_(ln_1_(x), mask);
  return attended + mlp_(ln_2_(attended));
}

ResidualCrossAttentionImpl::ResidualCrossAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias,
                                                       std::int64_t data_width) {
  const std::int64_t data = data_width > 0 ? data_width : width;
  attention_ = register_module("attn", InterleavedCrossAttention(width, data, heads, qkv_bias));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(data, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kMlpRatio * width, width));
  ln_3_ = register_module("ln_3", nn::AffineLayerNorm(width, kNormEps));
}

Tensor ResidualCrossAttentionImpl::forward(const Tensor& x, const Tensor& data, const KeyMask& mask) {
  const Tensor attended = x + attention_(ln_1_(x), ln_2_(data), mask);
  return attended + mlp_(ln_3_(attended));
}

ResidualStackImpl::ResidualStackImpl(std::int64_t layers, std::int64_t width, std::int64_t heads, bool qkv_bias) {
  require(layers >= 0, "layers", "must not be negative");
  for (std::int64_t i = 0; i < layers; ++i) blocks_.emplace_back(width, heads, qkv_bias);
  register_module("resblocks", nn::module_list(blocks_));
}

Tensor ResidualStackImpl::forward(Tensor x, const KeyMask& mask) {
  for (ResidualAttention& block : blocks_) x = block->forward(x, mask);
  return x;
}

}  // namespace anigen::models::anymate
