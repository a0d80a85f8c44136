#pragma once
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// True when cpu_bf16_attention() takes these queries on this CPU: bf16, heads of 16 to 64 channels, AVX512-BF16.
bool prefers_bf16_attention(const Tensor& q);

/// True when attention of these fp32 queries is to round its factors to bf16 (nn/kernels/mixed_products.h): queries,
/// keys, values, the softmax's weights, and the gradients of the output and of the scores. Softmax and sums stay fp32.
bool prefers_mixed_attention(const Tensor& q);

/// The forward pass of blocked_attention() by kernels for bf16. The bits do not depend on
/// the number of threads. Holds a copy of k and v beside the arguments.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], channels adjacent @param log_sums [B · H, N] fp32, filled
/// @return [B, N, H, D] bf16
Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums);

/// The forward pass of cpu_ragged_attention() by the kernels for bf16, where prefers_bf16_attention() or
/// prefers_mixed_attention() says so. Holds a copy of k and v of sequences with more than 192 queries or 1,024 keys
/// beside the arguments. The bits do not depend on the number of threads.
/// @param q, k, v bf16, channels adjacent @param out [N, H, D] bf16 or fp32, dense; rows of queries without keys are
/// left alone @param log_sums [H, N] fp32
void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums);

/// Tensors of the backward pass in mixed precision: factors in bf16, the rest fp32; channels adjacent.
struct MixedAttentionGradients {
  Tensor q, k, v;         ///< bf16, of the forward pass
  Tensor out, log_sums;   ///< fp32, of attend_ragged_bf16()
  Tensor dy, rounded_dy;  ///< dL/d out, dense, and the same in bf16
  Tensor dq, dk, dv;      ///< to be filled; rows without a partner are left alone
};

/// One thread at a time computes a head of a sequence, so that the bits do not depend on the number of threads.
void mixed_attention_backward(const RaggedProblem& problem, const MixedAttentionGradients& tensors);

inline constexpr std::int64_t kBf16Panel = 64;  ///< keys of a panel: four vectors of scores

inline std::int64_t padded_keys(std::int64_t count, std::int64_t step = kernels::kBf16Lanes) {
  return (count + step - 1) / step * step;
}

/// Rows as the columns of a product: panels of 64 rows, the last one of 16, 32, 48 or 64, [channels / 2, rows, 2] each,
/// filled up with zeros. @param rows [count, channels], `stride` apart @param packed [padded_keys(count) · channels]
void pack_bf16_keys(const std::uint16_t* rows, std::int64_t stride, std::int64_t count, std::int64_t channels,
                    std::uint16_t* packed);

/// Rows as the summed-over side of a product: [rows / 2, channels, 2], filled up with zeros to a multiple of 16 rows.
void pack_bf16_values(const std::uint16_t* rows, std::int64_t stride, std::int64_t count, std::int64_t channels,
                      std::uint16_t* packed);

}  // namespace anigen::nn
