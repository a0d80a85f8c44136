#include "anigen/nn/kernels/softmax.h"

#include <cmath>
#include <limits>

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

// Behind the last column, where rows are handled in whole vectors: never the largest, and its weight of e^-87 does not
// change a sum of at least one. Products of it and of scales up to one stay finite.
constexpr float kBelowScores = -1e38F;

// Several sums side by side, since compilers keep the order of additions of floats, are added up in pairs: rows are
// short, and a chain of sixteen additions would take as long as their exponentials.
ANIGEN_INLINE float total(float* lanes) {
  for (std::int64_t half = products::kLanes / 2; half > 0; half /= 2) {
    for (std::int64_t l = 0; l < half; ++l) lanes[l] += lanes[l + half];
  }
  return lanes[0];
}

// state.largest with the row in it. Leaves the exponent of state.shrink there, and NaN in the sum of a row that has
// scores that are not finite: the exponentials need not look for them.
ANIGEN_INLINE void take_largest(const float* row, std::int64_t whole, float scale, const RunningSoftmax& state,
                                std::int64_t r) {
  const float before = state.largest[r];
  const ScoreRange range = score_range(row, whole, before);
  const bool finite = range.smallest >= kBelowScores && range.largest <= std::numeric_limits<float>::max();
  state.largest[r] = range.largest;
  state.shrink[r] = scale * (before - range.largest);
  if (!finite) state.sum[r] = std::numeric_limits<float>::quiet_NaN();
}

ANIGEN_INLINE void take_weights(float* __restrict row, std::int64_t whole, float scale, const RunningSoftmax& state,
                                std::int64_t r) {
  const float largest = state.largest[r];
  float lanes[products::kLanes] = {};
  for (std::int64_t c = 0; c < whole; c += products::kLanes) {
    for (std::int64_t l = 0; l < products::kLanes; ++l) {
      const float weight = exp_up_to_0(scale * (row[c + l] - largest));
      row[c + l] = weight;
      lanes[l] += weight;
    }
  }
  state.shrink[r] = exp_clamped(state.shrink[r]);
  state.sum[r] = state.sum[r] * state.shrink[r] + total(lanes);
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

// Three passes, since a processor works on several rows at a time where none waits for a number of its own: for what
// was just written piece by piece, or for its largest score.
ANIGEN_KERNEL(void, softmax_rows,
              (const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
               const RunningSoftmax& state),
              (scores, rows, columns, scale, state)) {
  const std::int64_t whole = products::padded(columns);
  for (std::int64_t r = 0; r < rows && columns < whole; ++r) {
    float* row = scores.values + r * scores.stride;
    for (std::int64_t c = columns; c < whole; ++c) row[c] = kBelowScores;
  }
  for (std::int64_t r = 0; r < rows; ++r) take_largest(scores.values + r * scores.stride, whole, scale, state, r);
  for (std::int64_t r = 0; r < rows; ++r) take_weights(scores.values + r * scores.stride, whole, scale, state, r);
}

}  // namespace anigen::nn::kernels
