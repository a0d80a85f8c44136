#include "anigen/nn/norm_silu_kernels.h"

#include <algorithm>
#include <vector>

#include "anigen/nn/vector_exp.h"

namespace anigen::nn::kernels {
namespace {

ANIGEN_INLINE float sigmoid(float u) { return 1.0F / (1.0F + exp_or_nan(-u)); }

ANIGEN_KERNEL(void, activate, (float* values, std::int64_t n), (values, n)) {
  for (std::int64_t i = 0; i < n; ++i) values[i] *= sigmoid(values[i]);
}

// u becomes dy SiLU'(u).
ANIGEN_KERNEL(void, activate_backward, (const float* __restrict dy, float* __restrict u, std::int64_t n), (dy, u, n)) {
  for (std::int64_t i = 0; i < n; ++i) {
    const float s = sigmoid(u[i]);
    u[i] = dy[i] * s * (1.0F + u[i] * (1.0F - s));
  }
}

// Calls body(norm of some rows, the first of them), as many at a time as stay in a first-level cache with their slopes.
template <typename Body>
void for_cached_rows(const RowNorm& norm, const Body& body) {
  constexpr std::int64_t kCached = 2048;
  const std::int64_t most = std::max<std::int64_t>(1, kCached / norm.channels);
  for (std::int64_t first = 0; first < norm.rows; first += most) {
    RowNorm some = norm;
    some.rows = std::min(most, norm.rows - first);
    body(some, first);
  }
}

}  // namespace

void norm_silu_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, float* y, float* mean,
                    float* rstd) {
  for_cached_rows(norm, [&](const RowNorm& some, std::int64_t first) {
    float* const out = y + first * norm.channels;
    norm_rows(some, x + first * norm.channels, factor, shift, out, mean + first, rstd + first, {});
    activate(out, some.rows * norm.channels);
  });
}

void norm_silu_rows_backward(const RowNorm& norm, const float* x, const float* dy, const float* factor,
                             const float* shift, const float* mean, const float* rstd, float* dx, float* d_factor,
                             float* d_shift) {
  std::vector<float> slopes;
  for_cached_rows(norm, [&](const RowNorm& some, std::int64_t first) {
    const std::int64_t at = first * norm.channels, count = some.rows * norm.channels;
    slopes.resize(std::max(slopes.size(), static_cast<std::size_t>(count)));
    scale_rows(some, x + at, factor, shift, mean + first, rstd + first, slopes.data());
    activate_backward(dy + at, slopes.data(), count);
    norm_rows_backward(some, x + at, slopes.data(), factor, mean + first, rstd + first, dx + at, d_factor, d_shift, {});
  });
}

}  // namespace anigen::nn::kernels
