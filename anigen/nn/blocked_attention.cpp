#include "anigen/nn/blocked_attention.h"

#include <algorithm>

#include "anigen/nn/attention.h"
#include "anigen/nn/cpu_blocked_attention.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/tensor_blocked_attention.h"

namespace anigen::nn {
namespace {

constexpr std::int64_t kFewScores = 65536;             // below it, blocks cost more than they save
constexpr std::int64_t kShortRows = 256;               // sequences up to it have kernels without a product per head
constexpr std::int64_t kMostTensorScores = 1LL << 25;  // of all heads together in tensor_blocked_attention

// [B, H, N, D] → [B · N, H, D], a view of what a projection left.
Tensor as_rows(const Tensor& x) { return x.transpose(1, 2).flatten(0, 1); }

Tensor offsets_of(const Tensor& x) {
  return torch::arange(x.size(0) + 1, torch::TensorOptions().dtype(torch::kInt64)) * x.size(2);
}

// Calls of a product cost as much as the products of short sequences themselves.
Tensor short_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  const Tensor mixed = ragged_attention(as_rows(q), as_rows(k), as_rows(v), offsets_of(q), offsets_of(k));
  return mixed.view({q.size(0), q.size(2), q.size(1), q.size(3)}).transpose(1, 2);
}

}  // namespace

Tensor blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  TORCH_CHECK(q.dim() == 4 && k.dim() == 4 && v.sizes() == k.sizes() && q.size(0) == k.size(0) &&
                  q.size(1) == k.size(1) && q.size(3) == k.size(3) && k.size(2) > 0,
              "attention of queries ", q.sizes(), " to keys ", k.sizes(), " and values ", v.sizes());
  TORCH_CHECK(dtype_of(q) == dtype_of(k) && dtype_of(q) == dtype_of(v), "attention of queries of type ", q.dtype(),
              " to keys of type ", k.dtype(), " and values of type ", v.dtype());
  const std::int64_t per_query = q.size(0) * q.size(1) * k.size(2), scores = per_query * q.size(2);
  const bool half_on_cpu = q.is_cpu() && dtype_of(q) == torch::kHalf;  // not every LibTorch multiplies these
  if (scores == 0 || (scores < kFewScores && !half_on_cpu)) return attend(q, k, v);
  if (q.is_cpu() && dtype_of(q) != torch::kFloat64) {
    const bool is_short = q.size(2) <= kShortRows && k.size(2) <= kShortRows;
    return is_short ? short_attention(q, k, v) : cpu_blocked_attention(q, k, v);
  }
  if (kHasFusedAttention && q.is_cuda()) return fused_attention(q, k, v);
  return tensor_blocked_attention(q, k, v, std::max<std::int64_t>(1, kMostTensorScores / per_query));
}

}  // namespace anigen::nn
