#pragma once
#include <cstdint>

#include "anigen/nn/kernels/aligned_vector.h"

/// Products of rows of fp32 or bf16 numbers with a matrix of 8-bit integers. Each row is rounded to integers of its own
/// as it is multiplied, with a scale for every kInt8Group numbers; sums of a group are exact integers, sums over groups
/// fp32. bf16 numbers are passed as their 16 bits.
/// With AVX512-VNNI integers are multiplied four at a time; other processors multiply the same integers as fp32,
/// exactly, so that results differ by the rounding of sums over groups, and of rows at ties.
namespace anigen::nn::kernels {

inline constexpr std::int64_t kInt8Group = 128;        ///< numbers along the depth that share a scale
inline constexpr std::int64_t kInt8PanelColumns = 64;  ///< columns that are packed together

/// True if this CPU multiplies 8-bit integers four at a time, and ANIGEN_KERNELS asks for nothing narrower than avx512.
bool has_int8_products();

/// A matrix [depth, columns] of w ≈ scale · q, q an integer of at most ±127. Columns are padded to whole panels, the
/// depth to whole groups, with zeros.
struct Int8Matrix {
  std::int64_t depth = 0, columns = 0;
  AlignedVector<std::int8_t> values;   ///< [panel, depth / 4, column of the panel, 4], depth padded
  AlignedVector<float> scales;         ///< [group, column], columns padded
  AlignedVector<std::int32_t> starts;  ///< likewise: −128 Σ q of the group, since rows are multiplied as q + 128

  std::int64_t groups() const { return (depth + kInt8Group - 1) / kInt8Group; }
  std::int64_t panels() const { return (columns + kInt8PanelColumns - 1) / kInt8PanelColumns; }
  std::int64_t padded_columns() const { return panels() * kInt8PanelColumns; }
  std::size_t bytes() const { return values.size() + 4 * (scales.size() + starts.size()); }
};

/// Rounds a matrix to integers. A column that holds integer multiples of its largest value / 127 already, as weights
/// that were stored in 8 bits do, keeps them exactly. @param weight [columns, depth], finite
Int8Matrix round_to_int8(const float* weight, std::int64_t columns, std::int64_t depth);

/// The numbers that a rounded matrix stands for. @param weight [columns, depth]
void widen_int8(const Int8Matrix& matrix, float* weight);

/// Rows rounded for multiply_int8(): q + 128 of each number, and scales.
struct Int8Rows {
  AlignedVector<std::uint8_t> values;  ///< [group, row, kInt8Group]
  AlignedVector<float> scales;         ///< [group, row]
};

/// @param x [rows, depth], rows `stride` numbers apart; a group with a number that is not finite gets a scale of NaN,
/// one whose numbers are all smaller than kSmallestInt8 a scale of 0
void round_rows_to_int8(const float* x, std::int64_t rows, std::int64_t depth, std::int64_t stride, Int8Rows& rounded);
void round_rows_to_int8(const std::uint16_t* x, std::int64_t rows, std::int64_t depth, std::int64_t stride,
                        Int8Rows& rounded);

inline constexpr float kSmallestInt8 = 1e-30F;  ///< 127 over it is far from the largest float

/// out[r, c] = Σ_k x[r, k] · w[k, c] for the columns of one panel. One thread.
/// @param rows as many as were rounded @param out [rows, kInt8PanelColumns]
void multiply_int8(const Int8Rows& x, std::int64_t rows, const Int8Matrix& matrix, std::int64_t panel, float* out);

/// out[r, c] = panel[r, c] + bias[c] for c < columns. @param panel [rows, kInt8PanelColumns]
/// @param bias [kInt8PanelColumns] @param out rows `stride` numbers apart
void add_bias_to_panel(const float* panel, std::int64_t rows, std::int64_t columns, const float* bias, float* out,
                       std::int64_t stride);
void add_bias_to_panel(const float* panel, std::int64_t rows, std::int64_t columns, const float* bias,
                       std::uint16_t* out, std::int64_t stride);

}  // namespace anigen::nn::kernels
