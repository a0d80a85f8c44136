#include "anigen/nn/attention_kernels.h"

#include <cmath>

#include "anigen/nn/largest_score.h"
#include "anigen/nn/vector_exp.h"

namespace anigen::nn::kernels {
namespace {

// Several partial sums, since compilers keep the order of additions of floats.
ANIGEN_INLINE float sum_of_row(const float* row, std::int64_t n) {
  constexpr std::int64_t kLanes = 64;
  float lanes[kLanes] = {};
  std::int64_t c = 0;
  for (; c + kLanes <= n; c += kLanes) {
    for (std::int64_t l = 0; l < kLanes; ++l) lanes[l] += row[c + l];
  }
  float sum = 0.0F;
  for (std::int64_t l = 0; l < kLanes; ++l) sum += lanes[l];
  for (; c < n; ++c) sum += row[c];
  return sum;
}

}  // namespace

ANIGEN_KERNEL(void, softmax_block,
              (float* __restrict scores, std::int64_t rows, std::int64_t columns, float scale,
               const RunningSoftmax& state),
              (scores, rows, columns, scale, state)) {
  for (std::int64_t r = 0; r < rows; ++r, scores += columns) {
    const float before = state.largest[r], largest = largest_score(scores, columns, before);
    for (std::int64_t c = 0; c < columns; ++c) scores[c] = exp_or_nan(scale * (scores[c] - largest));
    const float shrink = exp_clamped(scale * (before - largest));
    state.largest[r] = largest;
    state.shrink[r] = shrink;
    state.sum[r] = state.sum[r] * shrink + sum_of_row(scores, columns);
  }
}

ANIGEN_KERNEL(void, scale_rows,
              (float* __restrict values, std::int64_t rows, std::int64_t columns, const float* __restrict factors),
              (values, rows, columns, factors)) {
  for (std::int64_t r = 0; r < rows; ++r, values += columns) {
    for (std::int64_t c = 0; c < columns; ++c) values[c] *= factors[r];
  }
}

ANIGEN_KERNEL(void, softmax_finish,
              (const float* __restrict values, std::int64_t rows, std::int64_t columns, float scale,
               const RunningSoftmax& state, float* __restrict out, std::int64_t stride, float* __restrict log_sums),
              (values, rows, columns, scale, state, out, stride, log_sums)) {
  for (std::int64_t r = 0; r < rows; ++r, values += columns, out += stride) {
    const float factor = 1.0F / state.sum[r];
    for (std::int64_t c = 0; c < columns; ++c) out[c] = values[c] * factor;
    log_sums[r] = scale * state.largest[r] + std::log(state.sum[r]);
  }
}

ANIGEN_KERNEL(void, softmax_backward_block,
              (float* __restrict scores, float* __restrict slopes, std::int64_t rows, std::int64_t columns, float scale,
               const float* __restrict log_sums, const float* __restrict delta),
              (scores, slopes, rows, columns, scale, log_sums, delta)) {
  for (std::int64_t r = 0; r < rows; ++r, scores += columns, slopes += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float weight = exp_or_nan(scale * scores[c] - log_sums[r]);
      scores[c] = weight;
      slopes[c] = scale * weight * (slopes[c] - delta[r]);
    }
  }
}

}  // namespace anigen::nn::kernels
