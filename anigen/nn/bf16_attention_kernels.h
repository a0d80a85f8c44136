#pragma once
#include <cstdint>

#include "anigen/nn/rows_ahead.h"

namespace anigen::nn::kernels {

/// Attention of one head in bf16, where has_bf16_products() of bf16_tile.h says so: products of bf16 numbers are exact
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
