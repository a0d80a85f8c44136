#pragma once
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::nn::kernels {

/// Attention of one head in bf16, where has_bf16_products() says so: products of bf16 numbers are exact
/// and added up in fp32, the softmax is fp32, its weights are rounded to bf16 before they meet the values.
///
/// bf16 numbers are passed as their 16 bits. Packing needs the same processor.
struct Bf16Keys {
  const std::uint16_t* keys;    ///< of pack_bf16_keys
  const std::uint16_t* values;  ///< of pack_bf16_values
  std::int64_t count, channels;
  float scale;  ///< of the scores
};

/// Head sizes that the kernels are made for: multiples of 16 up to 64.
bool bf16_attention_takes(std::int64_t channels);

/// 16-bit numbers of packed keys, and as many of packed values.
std::int64_t packed_bf16_size(std::int64_t count, std::int64_t channels);
/// Panels of 64 keys, the last one of 16, 32, 48 or 64: [channels / 2, keys, 2] each, filled up with zeros.
/// @param rows [count, channels], rows `stride` apart
void pack_bf16_keys(const std::uint16_t* rows, std::int64_t stride, std::int64_t count, std::int64_t channels,
                    std::uint16_t* packed);
/// [keys / 2, channels, 2], filled up with zeros to a multiple of 16 keys.
void pack_bf16_values(const std::uint16_t* rows, std::int64_t stride, std::int64_t count, std::int64_t channels,
                      std::uint16_t* packed);

/// Rows that attend_bf16 takes at most, and the floats of scratch it needs.
inline constexpr std::int64_t kBf16QueryBlock = 96;
/// Rows that are computed together: a multiple of it wastes nothing.
inline constexpr std::int64_t kBf16QueryTile = 6;
std::int64_t bf16_scratch_floats(std::int64_t channels);

/// out[r, :] = softmax(scale q[r, :] keysᵀ) values, and the log-sum-exp of the scaled scores of each row. A row with
/// scores that are not finite becomes NaN.
/// @param q [rows, channels], rows `q_stride` apart @param out rows `out_stride` apart @param ahead asked
/// bf16_asking_calls times, evenly over the products
void attend_bf16(const Bf16Keys& head, const std::uint16_t* q, std::int64_t q_stride, std::int64_t rows,
                 std::uint16_t* out, std::int64_t out_stride, float* log_sums, float* scratch,
                 products::RowsAhead& ahead);
std::int64_t bf16_asking_calls(std::int64_t queries, std::int64_t keys, std::int64_t channels);

}  // namespace anigen::nn::kernels

namespace anigen::nn {

/// True when cpu_bf16_attention() takes these queries on this CPU: bf16, heads of 16 to 64 channels, AVX512-BF16.
bool prefers_bf16_attention(const Tensor& q);

/// The forward pass of blocked_attention() by kernels for bf16. The bits do not depend on
/// the number of threads. Holds a copy of k and v beside the arguments.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], channels adjacent @param log_sums [B · H, N] fp32, filled
/// @return [B, N, H, D] bf16
Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums);

/// The forward pass of cpu_ragged_attention() by the kernels for bf16, where prefers_bf16_attention() says so.
/// Holds a copy of k and v of sequences with more than 192 queries or 1,024 keys beside the arguments. The bits do not
/// depend on the number of threads.
/// @param q, k, v bf16, channels adjacent @param out [N, H, D] bf16, dense; rows of queries without keys are left alone
/// @param log_sums [H, N] fp32
void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums);

}  // namespace anigen::nn
