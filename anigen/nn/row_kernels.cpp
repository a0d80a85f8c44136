#include "anigen/nn/row_kernels.h"

#include <cmath>

#include "anigen/nn/row_vectors.h"

namespace anigen::nn::kernels {
namespace {

template <typename Width>
ANIGEN_INLINE float row_sum(const float* row, std::int64_t n) {
  typename Width::Lanes lanes{};
  std::int64_t c = 0;
  for (; c + Width::kLanes <= n; c += Width::kLanes) lanes += lanes_at<Width>(row + c);
  float sum = total(lanes);
  for (; c < n; ++c) sum += row[c];
  return sum;
}

struct Moments {
  float mean, variance;
};

// Both around a first mean, whose rounding would otherwise be most of what is left of a row of nearly equal numbers
// far from 0.
template <typename Width>
ANIGEN_INLINE Moments row_moments(const float* row, std::int64_t n) {
  const float members = static_cast<float>(n), start = row_sum<Width>(row, n) / members;
  typename Width::Lanes lanes{}, squares{};
  std::int64_t c = 0;
  for (; c + Width::kLanes <= n; c += Width::kLanes) {
    const typename Width::Lanes beyond = lanes_at<Width>(row + c) - start;
    lanes += beyond;
    squares += beyond * beyond;
  }
  float sum = total(lanes), squares_sum = total(squares);
  for (; c < n; ++c) {
    sum += row[c] - start;
    squares_sum += (row[c] - start) * (row[c] - start);
  }
  const float rest = sum / members, variance = squares_sum / members - rest * rest;
  return {start + rest, variance < 0.0F ? 0.0F : variance};  // NaN stays NaN
}

// y = (x − mean) rstd (base + factor) + shift
template <typename Width>
ANIGEN_INLINE void scale_row(const RowNorm& norm, const float* row, const float* factor, const float* shift, float mean,
                             float rstd, float* out) {
  std::int64_t c = 0;
  for (; c + Width::kLanes <= norm.channels; c += Width::kLanes) {
    lanes_at<Width>(out + c) = (lanes_at<Width>(row + c) - mean) * rstd * (lanes_at<Width>(factor + c) + norm.base) +
                               lanes_at<Width>(shift + c);
  }
  for (; c < norm.channels; ++c) out[c] = (row[c] - mean) * rstd * (norm.base + factor[c]) + shift[c];
}

template <typename Width, typename T>
ANIGEN_INLINE void norm_by(const RowNorm& norm, const T* x, const float* factor, const float* shift, T* y, float* means,
                           float* rstds, const RowScratch& scratch) {
  const std::int64_t n = norm.channels;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, y += n) {
    const float* const row = widened(x, n, scratch.x);
    const Moments moments = row_moments<Width>(row, n);
    const float rstd = 1.0F / std::sqrt(moments.variance + norm.eps);
    float* const out = wide_row(y, scratch.dy);
    scale_row<Width>(norm, row, factor, shift, moments.mean, rstd, out);
    round_row(out, n, y);
    means[r] = moments.mean;
    rstds[r] = rstd;
  }
}

template <typename T>
ANIGEN_INLINE void norm(const RowNorm& norm, const T* x, const float* factor, const float* shift, T* y, float* means,
                        float* rstds, const RowScratch& scratch) {
  if (fills_wide(norm.channels)) {
    norm_by<Wide>(norm, x, factor, shift, y, means, rstds, scratch);
  } else {
    norm_by<Narrow>(norm, x, factor, shift, y, means, rstds, scratch);
  }
}

// With g = dy (base + factor): dx = (g − (Σ g + x̂ Σ g x̂) / C) / σ, d_factor = Σ dy x̂, d_shift = Σ dy.
template <typename Width, typename T>
ANIGEN_INLINE void norm_backward_by(const RowNorm& norm, const T* x, const T* dy, const float* factor,
                                    const float* means, const float* rstds, T* dx, float* d_factor, float* d_shift,
                                    const RowScratch& scratch) {
  using Lanes = typename Width::Lanes;
  const std::int64_t n = norm.channels;
  const auto members = static_cast<float>(n);
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, dy += n, dx += n) {
    const float *const row = widened(x, n, scratch.x), *const slope = widened(dy, n, scratch.dy);
    const float mean = means[r], rstd = rstds[r];
    Lanes sums{}, with_unit{};
    std::int64_t c = 0;
    for (; c + Width::kLanes <= n; c += Width::kLanes) {
      const Lanes d = lanes_at<Width>(slope + c), unit = (lanes_at<Width>(row + c) - mean) * rstd;
      const Lanes g = d * (lanes_at<Width>(factor + c) + norm.base);
      sums += g;
      with_unit += g * unit;
      lanes_at<Width>(d_factor + c) += d * unit;
      lanes_at<Width>(d_shift + c) += d;
    }
    float sum = total(sums), unit_sum = total(with_unit);
    for (; c < n; ++c) {
      const float unit = (row[c] - mean) * rstd, g = slope[c] * (norm.base + factor[c]);
      sum += g;
      unit_sum += g * unit;
      d_factor[c] += slope[c] * unit;
      d_shift[c] += slope[c];
    }
    const float constant = sum / members, of_unit = unit_sum / members;
    float* const out = wide_row(dx, scratch.x);
    for (c = 0; c + Width::kLanes <= n; c += Width::kLanes) {
      const Lanes unit = (lanes_at<Width>(row + c) - mean) * rstd;
      const Lanes g = lanes_at<Width>(slope + c) * (lanes_at<Width>(factor + c) + norm.base);
      lanes_at<Width>(out + c) = rstd * (g - constant - unit * of_unit);
    }
    for (; c < n; ++c) {
      const float unit = (row[c] - mean) * rstd;
      out[c] = rstd * (slope[c] * (norm.base + factor[c]) - constant - unit * of_unit);
    }
    round_row(out, n, dx);
  }
}

template <typename T>
ANIGEN_INLINE void norm_backward(const RowNorm& norm, const T* x, const T* dy, const float* factor, const float* means,
                                 const float* rstds, T* dx, float* d_factor, float* d_shift,
                                 const RowScratch& scratch) {
  if (fills_wide(norm.channels)) {
    norm_backward_by<Wide>(norm, x, dy, factor, means, rstds, dx, d_factor, d_shift, scratch);
  } else {
    norm_backward_by<Narrow>(norm, x, dy, factor, means, rstds, dx, d_factor, d_shift, scratch);
  }
}

ANIGEN_INLINE float as_float(float x) { return x; }
ANIGEN_INLINE float as_float(std::uint16_t x) { return bits_as<float>(static_cast<std::uint32_t>(x) << 16); }
ANIGEN_INLINE void store(float x, float* to) { *to = x; }
ANIGEN_INLINE void store(float x, std::uint16_t* to) { round_row(&x, 1, to); }

template <typename T>
ANIGEN_INLINE void gated(std::int64_t rows, std::int64_t n, const T* __restrict x, const float* __restrict gate,
                         const T* __restrict result, T* __restrict y) {
  for (std::int64_t r = 0; r < rows; ++r, x += n, result += n, y += n) {
    for (std::int64_t c = 0; c < n; ++c) store(as_float(x[c]) + gate[c] * as_float(result[c]), y + c);
  }
}

template <typename T>
ANIGEN_INLINE void gated_backward(std::int64_t rows, std::int64_t n, const T* __restrict dy,
                                  const float* __restrict gate, const T* __restrict result, T* __restrict d_result,
                                  float* __restrict d_gate) {
  for (std::int64_t r = 0; r < rows; ++r, dy += n, result += n, d_result += n) {
    for (std::int64_t c = 0; c < n; ++c) {
      store(as_float(dy[c]) * gate[c], d_result + c);
      d_gate[c] += as_float(dy[c]) * as_float(result[c]);
    }
  }
}

}  // namespace

ANIGEN_KERNEL(void, norm_rows,
              (const RowNorm& shape, const float* x, const float* factor, const float* shift, float* y, float* mean,
               float* rstd, const RowScratch& scratch),
              (shape, x, factor, shift, y, mean, rstd, scratch)) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_KERNEL(void, norm_rows,
              (const RowNorm& shape, const std::uint16_t* x, const float* factor, const float* shift, std::uint16_t* y,
               float* mean, float* rstd, const RowScratch& scratch),
              (shape, x, factor, shift, y, mean, rstd, scratch)) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_KERNEL(void, scale_rows,
              (const RowNorm& norm, const float* x, const float* factor, const float* shift, const float* mean,
               const float* rstd, float* y),
              (norm, x, factor, shift, mean, rstd, y)) {
  const std::int64_t n = norm.channels;
  for (std::int64_t r = 0; r < norm.rows; ++r) {
    if (fills_wide(n)) {
      scale_row<Wide>(norm, x + r * n, factor, shift, mean[r], rstd[r], y + r * n);
    } else {
      scale_row<Narrow>(norm, x + r * n, factor, shift, mean[r], rstd[r], y + r * n);
    }
  }
}

ANIGEN_KERNEL(void, norm_rows_backward,
              (const RowNorm& shape, const float* x, const float* dy, const float* factor, const float* mean,
               const float* rstd, float* dx, float* d_factor, float* d_shift, const RowScratch& scratch),
              (shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch)) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

ANIGEN_KERNEL(void, norm_rows_backward,
              (const RowNorm& shape, const std::uint16_t* x, const std::uint16_t* dy, const float* factor,
               const float* mean, const float* rstd, std::uint16_t* dx, float* d_factor, float* d_shift,
               const RowScratch& scratch),
              (shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch)) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

ANIGEN_KERNEL(void, add_gated_rows,
              (std::int64_t rows, std::int64_t channels, const float* x, const float* gate, const float* result,
               float* y),
              (rows, channels, x, gate, result, y)) {
  gated(rows, channels, x, gate, result, y);
}

ANIGEN_KERNEL(void, add_gated_rows,
              (std::int64_t rows, std::int64_t channels, const std::uint16_t* x, const float* gate,
               const std::uint16_t* result, std::uint16_t* y),
              (rows, channels, x, gate, result, y)) {
  gated(rows, channels, x, gate, result, y);
}

ANIGEN_KERNEL(void, add_gated_rows_backward,
              (std::int64_t rows, std::int64_t channels, const float* dy, const float* gate, const float* result,
               float* d_result, float* d_gate),
              (rows, channels, dy, gate, result, d_result, d_gate)) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

ANIGEN_KERNEL(void, add_gated_rows_backward,
              (std::int64_t rows, std::int64_t channels, const std::uint16_t* dy, const float* gate,
               const std::uint16_t* result, std::uint16_t* d_result, float* d_gate),
              (rows, channels, dy, gate, result, d_result, d_gate)) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

}  // namespace anigen::nn::kernels
