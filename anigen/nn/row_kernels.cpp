#include "anigen/nn/row_kernels.h"

#include <algorithm>
#include <cmath>

#include "anigen/nn/vector_exp.h"

namespace anigen::nn::kernels {
namespace {

// Partial sums side by side, since compilers keep the order of additions of floats.
constexpr std::int64_t kLanes = 16;
typedef float Lanes __attribute__((vector_size(64)));
typedef float Unaligned __attribute__((vector_size(64), aligned(4), may_alias));

// By reference, and inlined: how vectors are passed depends on the instruction set.
ANIGEN_INLINE float total(const Lanes& lanes) {
  float parts[8];
  for (int i = 0; i < 8; ++i) parts[i] = lanes[i] + lanes[i + 8];
  return ((parts[0] + parts[4]) + (parts[2] + parts[6])) + ((parts[1] + parts[5]) + (parts[3] + parts[7]));
}

ANIGEN_INLINE const Unaligned& lanes_at(const float* values) { return *reinterpret_cast<const Unaligned*>(values); }
ANIGEN_INLINE Unaligned& lanes_at(float* values) { return *reinterpret_cast<Unaligned*>(values); }

ANIGEN_INLINE const float* widened(const float* values, std::int64_t, float*) { return values; }

ANIGEN_INLINE const float* widened(const std::uint16_t* values, std::int64_t n, float* wide) {
  for (std::int64_t c = 0; c < n; ++c) wide[c] = bits_as<float>(static_cast<std::uint32_t>(values[c]) << 16);
  return wide;
}

// Where results are computed: in place, or in fp32 before they are rounded.
ANIGEN_INLINE float* wide_row(float* values, float*) { return values; }
ANIGEN_INLINE float* wide_row(std::uint16_t*, float* wide) { return wide; }

ANIGEN_INLINE void round_row(const float*, std::int64_t, float*) {}

// To the nearest, ties to even; NaN stays NaN.
ANIGEN_INLINE void round_row(const float* wide, std::int64_t n, std::uint16_t* values) {
  for (std::int64_t c = 0; c < n; ++c) {
    const auto bits = bits_as<std::uint32_t>(wide[c]);
    const std::uint32_t rounded = (bits + 0x7FFFU + ((bits >> 16) & 1U)) >> 16;
    const bool is_nan = (bits & 0x7FFFFFFFU) > 0x7F800000U;
    values[c] = static_cast<std::uint16_t>(is_nan ? 0x7FC0U : rounded);
  }
}

ANIGEN_INLINE float mean_beyond(const float* row, std::int64_t n, float start) {
  Lanes lanes{};
  std::int64_t c = 0;
  for (; c + kLanes <= n; c += kLanes) lanes += lanes_at(row + c) - start;
  float sum = total(lanes);
  for (; c < n; ++c) sum += row[c] - start;
  return start + sum / static_cast<float>(n);
}

// Once more around the first result: a row of nearly equal numbers far from 0 would otherwise be mostly its rounding.
ANIGEN_INLINE float row_mean(const float* row, std::int64_t n) {
  return mean_beyond(row, n, mean_beyond(row, n, 0.0F));
}

ANIGEN_INLINE float squares_around(const float* row, std::int64_t n, float mean) {
  Lanes lanes{};
  std::int64_t c = 0;
  for (; c + kLanes <= n; c += kLanes) {
    const Lanes centred = lanes_at(row + c) - mean;
    lanes += centred * centred;
  }
  float sum = total(lanes);
  for (; c < n; ++c) sum += (row[c] - mean) * (row[c] - mean);
  return sum;
}

template <typename T>
ANIGEN_INLINE void norm(const RowNorm& norm, const T* x, const float* factor, const float* shift, T* y, float* means,
                        float* rstds, const RowScratch& scratch) {
  const std::int64_t n = norm.channels;
  const auto members = static_cast<float>(n);
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, y += n) {
    const float* const row = widened(x, n, scratch.x);
    const float mean = row_mean(row, n);
    const float rstd = 1.0F / std::sqrt(squares_around(row, n, mean) / members + norm.eps);
    float* const out = wide_row(y, scratch.dy);
    for (std::int64_t c = 0; c < n; ++c) out[c] = (row[c] - mean) * rstd * (norm.base + factor[c]) + shift[c];
    round_row(out, n, y);
    means[r] = mean;
    rstds[r] = rstd;
  }
}

// With g = dy (base + factor): dx = (g − (Σ g + x̂ Σ g x̂) / C) / σ, d_factor = Σ dy x̂, d_shift = Σ dy.
template <typename T>
ANIGEN_INLINE void norm_backward(const RowNorm& norm, const T* x, const T* dy, const float* factor, const float* means,
                                 const float* rstds, T* dx, float* d_factor, float* d_shift,
                                 const RowScratch& scratch) {
  const std::int64_t n = norm.channels;
  const auto members = static_cast<float>(n);
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, dy += n, dx += n) {
    const float *const row = widened(x, n, scratch.x), *const slope = widened(dy, n, scratch.dy);
    const float mean = means[r], rstd = rstds[r];
    Lanes sums{}, with_unit{};
    std::int64_t c = 0;
    for (; c + kLanes <= n; c += kLanes) {
      const Lanes d = lanes_at(slope + c), unit = (lanes_at(row + c) - mean) * rstd;
      const Lanes g = d * (lanes_at(factor + c) + norm.base);
      sums += g;
      with_unit += g * unit;
      lanes_at(d_factor + c) += d * unit;
      lanes_at(d_shift + c) += d;
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
    for (c = 0; c < n; ++c) {
      const float unit = (row[c] - mean) * rstd;
      out[c] = rstd * (slope[c] * (norm.base + factor[c]) - constant - unit * of_unit);
    }
    round_row(out, n, dx);
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

// 1 / max(‖x‖₂, 1e-12)
ANIGEN_INLINE float inverse_length(const float* x, std::int64_t n) {
  return 1.0F / std::max(std::sqrt(squares_around(x, n, 0.0F)), 1e-12F);
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

ANIGEN_VECTOR_CLONES
void norm_rows(const RowNorm& shape, const float* x, const float* factor, const float* shift, float* y, float* mean,
               float* rstd, const RowScratch& scratch) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_VECTOR_CLONES
void norm_rows(const RowNorm& shape, const std::uint16_t* x, const float* factor, const float* shift, std::uint16_t* y,
               float* mean, float* rstd, const RowScratch& scratch) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_VECTOR_CLONES
void norm_rows_backward(const RowNorm& shape, const float* x, const float* dy, const float* factor, const float* mean,
                        const float* rstd, float* dx, float* d_factor, float* d_shift, const RowScratch& scratch) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

ANIGEN_VECTOR_CLONES
void norm_rows_backward(const RowNorm& shape, const std::uint16_t* x, const std::uint16_t* dy, const float* factor,
                        const float* mean, const float* rstd, std::uint16_t* dx, float* d_factor, float* d_shift,
                        const RowScratch& scratch) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

ANIGEN_VECTOR_CLONES
void add_gated_rows(std::int64_t rows, std::int64_t channels, const float* x, const float* gate, const float* result,
                    float* y) {
  gated(rows, channels, x, gate, result, y);
}

ANIGEN_VECTOR_CLONES
void add_gated_rows(std::int64_t rows, std::int64_t channels, const std::uint16_t* x, const float* gate,
                    const std::uint16_t* result, std::uint16_t* y) {
  gated(rows, channels, x, gate, result, y);
}

ANIGEN_VECTOR_CLONES
void add_gated_rows_backward(std::int64_t rows, std::int64_t channels, const float* dy, const float* gate,
                             const float* result, float* d_result, float* d_gate) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

ANIGEN_VECTOR_CLONES
void add_gated_rows_backward(std::int64_t rows, std::int64_t channels, const std::uint16_t* dy, const float* gate,
                             const std::uint16_t* result, std::uint16_t* d_result, float* d_gate) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

ANIGEN_VECTOR_CLONES
void rms_norm_rows(const HeadNorm& shape, const float* x, const float* factors, float* y) {
  rms_norm(shape, x, factors, y, nullptr);
}

ANIGEN_VECTOR_CLONES
void rms_norm_rows(const HeadNorm& shape, const std::uint16_t* x, const float* factors, std::uint16_t* y,
                   float* scratch) {
  rms_norm(shape, x, factors, y, scratch);
}

// With x̂ of length 1 and g = factors dy: dx = (g − x̂ Σ g x̂) / ‖x‖, d_factors = Σ dy x̂. A head shorter than 1e-12 was
// multiplied with a constant.
ANIGEN_VECTOR_CLONES
void rms_norm_rows_backward(const HeadNorm& norm, const float* x, const float* dy, const float* factors, float* dx,
                            float* d_factors) {
  const std::int64_t n = norm.channels, width = norm.heads * n;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += norm.x_stride, dy += width, dx += width) {
    for (std::int64_t h = 0; h < norm.heads; ++h) {
      const float *const head = x + h * n, *const slope = dy + h * n, *const factor = factors + h * n;
      float *const out = dx + h * n, *const d_factor = d_factors + h * n;
      const float inverse = inverse_length(head, n);
      Lanes sums{};
      std::int64_t c = 0;
      for (; c + kLanes <= n; c += kLanes) {
        const Lanes d_unit = lanes_at(slope + c) * lanes_at(head + c) * inverse;
        sums += d_unit * lanes_at(factor + c);
        lanes_at(d_factor + c) += d_unit;
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
