#include "anigen/nn/ragged_softmax.h"

#include <limits>

#include "anigen/nn/largest_score.h"
#include "anigen/nn/vector_exp.h"

namespace anigen::nn {
namespace {

// Partial sums side by side, since compilers keep the order of additions of floats, then added in pairs: rows are
// short, and a chain of sixteen additions would take as long as their exponentials. @param n a multiple of kLanes
ANIGEN_INLINE float total_weight(const float* row, std::int64_t n) {
  float lanes[products::kLanes] = {};
  for (std::int64_t c = 0; c < n; c += products::kLanes) {
    for (std::int64_t l = 0; l < products::kLanes; ++l) lanes[l] += row[c + l];
  }
  for (std::int64_t half = products::kLanes / 2; half > 0; half /= 2) {
    for (std::int64_t l = 0; l < half; ++l) lanes[l] += lanes[l + half];
  }
  return lanes[0];
}

}  // namespace

ANIGEN_VECTOR_CLONES
void softmax_rows(const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
                  const kernels::RunningSoftmax& state) {
  const std::int64_t whole = products::padded(columns);
  for (std::int64_t r = 0; r < rows; ++r) {
    float* __restrict row = scores.values + r * scores.stride;
    for (std::int64_t c = columns; c < whole; ++c) row[c] = -std::numeric_limits<float>::infinity();
    const float before = state.largest[r], largest = kernels::largest_score(row, whole, before);
    for (std::int64_t c = 0; c < whole; ++c) row[c] = kernels::exp_or_nan(scale * (row[c] - largest));
    for (std::int64_t c = columns; c < whole; ++c) row[c] = 0.0F;
    const float shrink = kernels::exp_clamped(scale * (before - largest));
    state.largest[r] = largest;
    state.shrink[r] = shrink;
    state.sum[r] = state.sum[r] * shrink + total_weight(row, whole);
  }
}

}  // namespace anigen::nn
