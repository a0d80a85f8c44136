#pragma once
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"

/// Softmax of rows whose scores arrive in blocks of columns (Milakov and Gimelshein 2018, "Online normalizer
/// calculation for softmax"), and its backward pass. fp32, one thread, no allocation.

namespace anigen::nn::kernels {

/// State of the softmax of some rows, one value per row.
struct RunningSoftmax {
  float* largest;  ///< largest score so far; -inf before the first block
  float* sum;      ///< Σ exp(scale (score − largest)); 0 before the first block
  float* shrink;   ///< what earlier sums have to be multiplied with after this block
};

/// One block: on return each score holds exp(scale (score − largest)) and the state includes it. A row with a score
/// that is not finite gets the sum NaN. @param scores [rows, columns] dense
void softmax_block(float* scores, std::int64_t rows, std::int64_t columns, float scale, const RunningSoftmax& state);

/// softmax_block() for short rows with gaps between them: scores far below the largest become at least e^-87; from
/// `columns` to products::padded(columns) the rows may hold anything. A row with a score that is not finite, or below
/// -1e38, gets the sum NaN.
void softmax_rows(const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
                  const RunningSoftmax& state);

/// values[r, :] *= factors[r] @param values [rows, columns] dense
void scale_rows(float* values, std::int64_t rows, std::int64_t columns, const float* factors);

/// The end of the running softmax: out[r, :] = values[r, :] / sum[r], and log_sums[r] = scale · largest[r] + ln sum[r],
/// the log-sum-exp of the scaled scores. @param values [rows, columns] dense @param out rows `stride` values apart
void softmax_finish(const float* values, std::int64_t rows, std::int64_t columns, float scale,
                    const RunningSoftmax& state, float* out, std::int64_t stride, float* log_sums);

/// The backward pass of one block, in place: scores → weights p = exp(scale score − log_sums[r]); slopes dL/dp →
/// dL/dscore = scale p (dL/dp − delta[r]), where delta[r] = Σ p dL/dp over the whole row. Both [rows, columns] dense.
void softmax_backward_block(float* scores, float* slopes, std::int64_t rows, std::int64_t columns, float scale,
                            const float* log_sums, const float* delta);

}  // namespace anigen::nn::kernels
