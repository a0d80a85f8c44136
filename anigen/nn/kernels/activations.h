#pragma once
#include <ATen/Parallel.h>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "anigen/nn/kernels/rows.h"
#include "anigen/nn/torch.h"

/// SiLU(u) = u / (1 + e^−u) of dense rows of fp32 numbers that are normalised by row or by column; one thread.

namespace anigen::nn {

/// Some rows of one item, what a thread does at a time.
struct RowBlock {
  std::int64_t item, first, count;
};

/// All rows in order, in blocks of about as many numbers each. They depend on sizes alone, so that sums over rows are
/// the same for any number of threads.
inline std::vector<RowBlock> row_blocks(const std::vector<std::int64_t>& lengths, std::int64_t channels) {
  constexpr std::int64_t kNumbers = 32768;
  const std::int64_t most = std::max<std::int64_t>(16, kNumbers / std::max<std::int64_t>(1, channels));
  std::vector<RowBlock> blocks;
  std::int64_t row = 0;
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    for (const std::int64_t end = row + lengths[i]; row < end; row += blocks.back().count) {
      blocks.push_back({static_cast<std::int64_t>(i), row, std::min(most, end - row)});
    }
  }
  return blocks;
}

/// Calls body(block, number of the block) for all, by all threads.
template <typename Body>
void for_each_block(const std::vector<RowBlock>& blocks, const Body& body) {
  at::parallel_for(0, static_cast<std::int64_t>(blocks.size()), 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t b = begin; b < end; ++b) body(blocks[static_cast<std::size_t>(b)], b);
  });
}

/// A sum per block [blocks, C] added up per item, in the order of the blocks. @return [items, C] fp32
inline torch::Tensor sums_of_items(const std::vector<RowBlock>& blocks, const torch::Tensor& parts,
                                   std::int64_t items) {
  const std::int64_t channels = parts.size(1);
  const torch::Tensor sums = torch::zeros({items, channels}, parts.options());
  const float* part = parts.data_ptr<float>();
  for (const RowBlock& block : blocks) {
    float* const sum = sums.data_ptr<float>() + block.item * channels;
    for (std::int64_t c = 0; c < channels; ++c) sum[c] += part[c];
    part += channels;
  }
  return sums;
}

/// Σ over the rows, as for the gradient of a bias; bits do not depend on the number of threads. fp32 in CPU memory by
/// kernels, at any distance between rows. @param x [N, C] @return [C]
torch::Tensor sum_of_rows(const torch::Tensor& x);

}  // namespace anigen::nn

namespace anigen::nn::kernels {

/// y[i] = gelu(x[i]), tanh form; NaN stays NaN. Arrays of n values that do not overlap.
void gelu_forward(const float* x, float* y, std::int64_t n);

/// gelu_forward() of bf16 numbers, passed as their 16 bits, computed in fp32.
void gelu_forward_bf16(const std::uint16_t* x, std::uint16_t* y, std::int64_t n);

/// h[r, c] = gelu(h[r, c] + bias[c]) in place, for a dense matrix.
void gelu_bias(float* h, const float* bias, std::int64_t rows, std::int64_t columns);

/// The backward pass of gelu_bias, recomputing its result: on return h[r, c] holds gelu(h[r, c] + bias[c]) and
/// dh[r, c] is multiplied with the derivative there.
void gelu_bias_backward(float* h, const float* bias, float* dh, std::int64_t rows, std::int64_t columns);

/// dx[i] = dy[i] · gelu'(x[i])
void gelu_backward(const float* x, const float* dy, float* dx, std::int64_t n);

/// y = SiLU(LN(x) (base + factor) + shift), otherwise as norm_rows().
void norm_silu_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, float* y, float* mean,
                    float* rstd);

/// Adds to d_factor and d_shift, [C]. What SiLU was applied to is computed again, some rows at a time.
void norm_silu_rows_backward(const RowNorm& norm, const float* x, const float* dy, const float* factor,
                             const float* shift, const float* mean, const float* rstd, float* dx, float* d_factor,
                             float* d_shift);

/// Mean of each column and sum of squares around it, for rows that stay in a cache. @param mean, squares [C]
void column_moments(const float* x, std::int64_t rows, std::int64_t channels, float* mean, float* squares);

/// u = (x − mean) factor + shift with one number of each per column, and y = SiLU(u) or u.
struct ColumnNorm {
  std::int64_t rows, channels;
  const float *mean, *factor, *shift;
  bool silu;
};

void norm_columns(const ColumnNorm& norm, const float* x, float* y);

/// d = dy ∂y/∂u, Σ d and Σ d (x − mean) over the rows. @param d [rows, C] @param sums, with_centred [C], overwritten
void norm_columns_slopes(const ColumnNorm& norm, const float* x, const float* dy, float* d, float* sums,
                         float* with_centred);

/// With one number of each per column.
struct ColumnGradient {
  const float *of_slope, *of_centred, *constant;
};

/// dx = of_slope d + of_centred (x − mean) + constant, in place of d.
void norm_columns_backward(std::int64_t rows, std::int64_t channels, const float* x, const float* mean,
                           const ColumnGradient& gradient, float* d);

}  // namespace anigen::nn::kernels
