#pragma once
#include <cstdint>

#include "anigen/nn/rows_ahead.h"

/// Products of matrices that stay in the cache, such as the queries and keys of one window and head, where starting a
/// product of a library costs as much as the product. fp32, one thread, no allocation.
namespace anigen::nn::products {

/// Columns that are handled at a time: the rows of `right` and `out` below have space for a multiple of it.
inline constexpr std::int64_t kLanes = 16;

/// The next multiple of kLanes.
inline std::int64_t padded(std::int64_t columns) { return (columns + kLanes - 1) / kLanes * kLanes; }

/// A distance between rows with space for so many columns: an odd number of cache lines, so that a column of the matrix
/// does not fall into few sets of the cache.
inline std::int64_t spread_stride(std::int64_t columns) { return padded(columns) | kLanes; }

/// A factor whose values may be anywhere: (r, c) is values[r · row + c · column].
struct Factor {
  const float* values;
  std::int64_t row, column;
};

/// A matrix whose rows are `stride` values apart.
struct Block {
  float* values;
  std::int64_t stride;

  Factor plain() const { return {values, stride, 1}; }
  Factor transposed() const { return {values, 1, stride}; }
  Block from_row(std::int64_t row) const { return {values + row * stride, stride}; }
};

struct ProductSize {
  std::int64_t rows, columns, depth;
};

/// out = left right, or out += left right. Columns up to the next multiple of kLanes are read in `right` and written in
/// `out`. A row of the result does not depend on how many rows there are.
/// @param left [rows, depth] @param right [depth, columns] @param out [rows, columns], apart from both
/// @param ahead asked at least asking_calls(size) times, evenly over the product
void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate,
              RowsAhead& ahead);
void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate);

std::int64_t asking_calls(const ProductSize& size);

/// out(c, r) = in(r, c). @param rows, columns multiples of 4
void transpose(std::int64_t rows, std::int64_t columns, const Block& in, const Block& out);

}  // namespace anigen::nn::products
