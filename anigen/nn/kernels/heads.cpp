#include "anigen/nn/kernels/heads.h"

#include <cmath>

#include "anigen/nn/kernels/rows.h"

namespace anigen::nn::kernels {

namespace {

ANIGEN_INLINE float sum_of_squares(const float* row, std::int64_t n) {
  Sixteen lanes{};
  std::int64_t c = 0;
  for (; c + Wide::kLanes <= n; c += Wide::kLanes) lanes += lanes_at<Wide>(row + c) * lanes_at<Wide>(row + c);
  float sum = total(lanes);
  for (; c < n; ++c) sum += row[c] * row[c];
  return sum;
}

// 1 / max(‖x‖₂, 1e-12)
ANIGEN_INLINE float inverse_length(const float* x, std::int64_t n) {
  return 1.0F / std::max(std::sqrt(sum_of_squares(x, n)), 1e-12F);
}

template <typename T>
ANIGEN_INLINE void rms_norm(const HeadNorm& norm, const T* x, const float* factors, T* y, float* scratch) {
  const std::int64_t n = norm.channels;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += norm.x_stride, y += norm.heads * n) {
    for (std::int64_t h = 0; h < norm.heads; ++h) {
      const float* const head = widened(x + h * n, n, scratch);
      float* const out = wide_row(y + h * n, scratch);
      const float *const factor = factors + h * n, inverse = inverse_length(head, n);
      for (std::int64_t c = 0; c < n; ++c) out[c] = head[c] * inverse * factor[c];
      round_row(out, n, y + h * n);
    }
  }
}

}  // namespace

ANIGEN_KERNEL(void, rms_norm_rows, (const HeadNorm& shape, const float* x, const float* factors, float* y),
              (shape, x, factors, y)) {
  rms_norm(shape, x, factors, y, nullptr);
}

ANIGEN_KERNEL(void, rms_norm_rows,
              (const HeadNorm& shape, const std::uint16_t* x, const float* factors, std::uint16_t* y, float* scratch),
              (shape, x, factors, y, scratch)) {
  rms_norm(shape, x, factors, y, scratch);
}

// With x̂ of length 1 and g = factors dy: dx = (g − x̂ Σ g x̂) / ‖x‖, d_factors = Σ dy x̂. A head shorter than 1e-12 was
// multiplied with a constant.
ANIGEN_KERNEL(void, rms_norm_rows_backward,
              (const HeadNorm& norm, const float* x, const float* dy, const float* factors, float* dx,
               float* d_factors),
              (norm, x, dy, factors, dx, d_factors)) {
  const std::int64_t n = norm.channels, width = norm.heads * n;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += norm.x_stride, dy += width, dx += width) {
    for (std::int64_t h = 0; h < norm.heads; ++h) {
      const float *const head = x + h * n, *const slope = dy + h * n, *const factor = factors + h * n;
      float *const out = dx + h * n, *const d_factor = d_factors + h * n;
      const float inverse = inverse_length(head, n);
      Sixteen sums{};
      std::int64_t c = 0;
      for (; c + Wide::kLanes <= n; c += Wide::kLanes) {
        const Sixteen d_unit = lanes_at<Wide>(slope + c) * lanes_at<Wide>(head + c) * inverse;
        sums += d_unit * lanes_at<Wide>(factor + c);
        lanes_at<Wide>(d_factor + c) += d_unit;
      }
      float along = total(sums);
      for (; c < n; ++c) {
        const float d_unit = slope[c] * head[c] * inverse;
        along += d_unit * factor[c];
        d_factor[c] += d_unit;
      }
      if (inverse >= 1e12F) along = 0.0F;
      for (c = 0; c < n; ++c) out[c] = inverse * (slope[c] * factor[c] - head[c] * inverse * along);
    }
  }
}

}  // namespace anigen::nn::kernels
