#pragma once
#include <cstdint>
#include <vector>

/// Products of fp32 rows with a matrix of 8-bit integers. Each row is rounded to integers of its own as it is
/// multiplied, with a scale for every kInt8Group numbers; sums of a group are exact integers, sums over groups fp32.
/// With AVX512-VNNI integers are multiplied four at a time; other processors multiply the same integers as fp32,
/// exactly, so that results differ by the rounding of sums over groups alone.
namespace anigen::nn::kernels {

inline constexpr std::int64_t kInt8Group = 128;        ///< numbers along the depth that share a scale
inline constexpr std::int64_t kInt8PanelColumns = 64;  ///< columns that are packed together

/// True if this CPU multiplies 8-bit integers four at a time, and ANIGEN_KERNELS asks for nothing narrower than avx512.
bool has_int8_products();

/// A matrix [depth, columns] of w ≈ scale · q, q an integer of at most ±127. Columns are padded to whole panels, the
/// depth to whole groups, with zeros.
struct Int8Matrix {
  std::int64_t depth = 0, columns = 0;
  std::vector<std::int8_t> values;   ///< [panel, depth / 4, column of the panel, 4], depth padded
  std::vector<float> scales;         ///< [group, column], columns padded
  std::vector<std::int32_t> starts;  ///< likewise: −128 Σ q of the group, since rows are multiplied as q + 128

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
  std::vector<std::uint8_t> values;  ///< [group, row, kInt8Group]
  std::vector<float> scales;         ///< [group, row]
};

/// @param x [rows, depth], rows `stride` numbers apart; a group with a number that is not finite gets a scale of NaN
void round_rows_to_int8(const float* x, std::int64_t rows, std::int64_t depth, std::int64_t stride, Int8Rows& rounded);

/// out[r, c] = Σ_k x[r, k] · w[k, c] for the columns of one panel. One thread.
/// @param rows as many as were rounded @param out [rows, kInt8PanelColumns]
void multiply_int8(const Int8Rows& x, std::int64_t rows, const Int8Matrix& matrix, std::int64_t panel, float* out);

}  // namespace anigen::nn::kernels
