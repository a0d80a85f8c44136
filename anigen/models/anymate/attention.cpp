#include "anigen/models/anymate/attention.h"

#include <string>
#include <vector>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

void require_heads(std::int64_t width, std::int64_t heads) {
  require(width > 0 && heads > 0 && width % heads == 0, "heads",
          std::to_string(heads) + " heads do not divide a width of " + std::to_string(width));
}

// [B, N, H·(parts·d)] → parts views [B, H, N, d]; what belongs to one head lies together.
std::vector<Tensor> heads_of(const Tensor& x, std::int64_t heads, std::int64_t parts) {
  std::vector<Tensor> split = x.view({x.size(0), x.size(1), heads, x.size(2) / heads}).chunk(parts, -1);
  for (Tensor& part : split) part = part.transpose(1, 2);
  return split;
}

// [B, H, N, d] → [B, N, H·d]
Tensor merged_heads(const Tensor& x) { return x.transpose(1, 2).flatten(2); }

}  // namespace

InterleavedSelfAttentionImpl::InterleavedSelfAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  c_qkv_ = register_module("c_qkv", nn::Linear(width, 3 * width, qkv_bias));
  c_proj_ = register_module("c_proj", nn::Linear(width, width));
}

Tensor InterleavedSelfAttentionImpl::forward(const Tensor& x, const KeyMask& mask) {
  const std::vector<Tensor> qkv = heads_of(c_qkv_(x), heads_, 3);
  return c_proj_(merged_heads(masked_attention(qkv[0], qkv[1], qkv[2], mask)));
}

InterleavedCrossAttentionImpl::InterleavedCrossAttentionImpl(std::int64_t width, std::int64_t data_width,
                                                             std::int64_t heads, bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  c_q_ = register_module("c_q", nn::Linear(width, width, qkv_bias));
  c_kv_ = register_module("c_kv", nn::Linear(data_width, 2 * width, qkv_bias));
  c_proj_ = register_module("c_proj", nn::Linear(width, width));
}

Tensor InterleavedCrossAttentionImpl::forward(const Tensor& x, const Tensor& data, const KeyMask& mask) {
  const Tensor q = heads_of(c_q_(x), heads_, 1)[0];
  const std::vector<Tensor> kv = heads_of(c_kv_(data), heads_, 2);
  return c_proj_(merged_heads(masked_attention(q, kv[0], kv[1], mask)));
}

SeparateAttentionImpl::SeparateAttentionImpl(std::int64_t width, std::int64_t data_width, std::int64_t heads,
                                             bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  wq_ = register_module("wq", nn::Linear(width, width, qkv_bias));
  wk_ = register_module("wk", nn::Linear(data_width, width, qkv_bias));
  wv_ = register_module("wv", nn::Linear(data_width, width, qkv_bias));
  proj_ = register_module("proj", nn::Linear(width, width));
}

Tensor SeparateAttentionImpl::forward(const Tensor& x, const Tensor& data) {
  const Tensor q = heads_of(wq_(x), heads_, 1)[0], k = heads_of(wk_(data), heads_, 1)[0];
  return proj_(merged_heads(masked_attention(q, k, heads_of(wv_(data), heads_, 1)[0])));
}

}  // namespace anigen::models::anymate
