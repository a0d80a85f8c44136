#include "anigen/nn/kernels/activations.h"

#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn::kernels {

namespace {

constexpr float kSqrtTwoOverPi = 0.7978845608028654F;
constexpr float kCubic = 0.044715F;

// (1 + tanh(u)) / 2 as sigmoid(2u), which does not cancel for negative values.
ANIGEN_INLINE float gate(float x) {
  const float u = kSqrtTwoOverPi * (x + kCubic * (x * x * x));
  return 1.0F / (1.0F + exp_clamped(-2.0F * u));
}

// Bits of the nearest bf16 number, ties to even.
ANIGEN_INLINE std::uint16_t nearest_bf16(float x) {
  const auto bits = bits_as<std::uint32_t>(x);
  const bool is_nan = (bits & 0x7FFFFFFFU) > 0x7F800000U;  // whose bits would overflow
  const std::uint32_t nearest = (bits + 0x7FFFU + ((bits >> 16U) & 1U)) >> 16U;
  return static_cast<std::uint16_t>(is_nan ? 0x7FC0U : nearest);
}

// d/dx of x gate(x), given gate(x).
ANIGEN_INLINE float derivative(float x, float s) {
  const float slope = kSqrtTwoOverPi * (1.0F + 3.0F * kCubic * (x * x));
  return s + 2.0F * x * s * (1.0F - s) * slope;
}

}  // namespace

ANIGEN_KERNEL(void, gelu_forward, (const float* __restrict x, float* __restrict y, std::int64_t n), (x, y, n)) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = x[i] * gate(x[i]);
}

ANIGEN_KERNEL(void, gelu_forward_bf16, (const std::uint16_t* __restrict x, std::uint16_t* __restrict y, std::int64_t n),
              (x, y, n)) {
  for (std::int64_t i = 0; i < n; ++i) {
    const float value = bits_as<float>(static_cast<std::uint32_t>(x[i]) << 16U);
    y[i] = nearest_bf16(value * gate(value));
  }
}

ANIGEN_KERNEL(void, gelu_backward,
              (const float* __restrict x, const float* __restrict dy, float* __restrict dx, std::int64_t n),
              (x, dy, dx, n)) {
  for (std::int64_t i = 0; i < n; ++i) dx[i] = dy[i] * derivative(x[i], gate(x[i]));
}

ANIGEN_KERNEL(void, gelu_bias,
              (float* __restrict h, const float* __restrict bias, std::int64_t rows, std::int64_t columns),
              (h, bias, rows, columns)) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c];
      h[c] = x * gate(x);
    }
  }
}

ANIGEN_KERNEL(void, gelu_bias_backward,
              (float* __restrict h, const float* __restrict bias, float* __restrict dh, std::int64_t rows,
               std::int64_t columns),
              (h, bias, dh, rows, columns)) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns, dh += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c], s = gate(x);
      h[c] = x * s;
      dh[c] *= derivative(x, s);
    }
  }
}

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

// Around a first mean as row_moments(): s = Σ x / n, then Σ (x − s) and Σ (x − s)².
ANIGEN_KERNEL(void, column_moments,
              (const float* __restrict x, std::int64_t rows, std::int64_t channels, float* __restrict mean,
               float* __restrict squares),
              (x, rows, channels, mean, squares)) {
  const float members = static_cast<float>(rows);
  std::vector<float> start(static_cast<std::size_t>(channels), 0.0F);
  float* const __restrict first = start.data();
  for (std::int64_t r = 0; r < rows; ++r) {
    for (std::int64_t c = 0; c < channels; ++c) first[c] += x[r * channels + c];
  }
  for (std::int64_t c = 0; c < channels; ++c) {
    first[c] /= members;
    mean[c] = squares[c] = 0.0F;
  }
  for (std::int64_t r = 0; r < rows; ++r) {
    for (std::int64_t c = 0; c < channels; ++c) {
      const float beyond = x[r * channels + c] - first[c];
      mean[c] += beyond;
      squares[c] += beyond * beyond;
    }
  }
  for (std::int64_t c = 0; c < channels; ++c) {
    const float rest = mean[c] / members;
    squares[c] -= members * (rest * rest);
    mean[c] = first[c] + rest;
  }
}

ANIGEN_KERNEL(void, norm_columns, (const ColumnNorm& norm, const float* __restrict x, float* __restrict y),
              (norm, x, y)) {
  const float* __restrict mean = norm.mean, * __restrict factor = norm.factor, * __restrict shift = norm.shift;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += norm.channels, y += norm.channels) {
    if (norm.silu) {
      for (std::int64_t c = 0; c < norm.channels; ++c) {
        const float u = (x[c] - mean[c]) * factor[c] + shift[c];
        y[c] = u * sigmoid(u);
      }
    } else {
      for (std::int64_t c = 0; c < norm.channels; ++c) y[c] = (x[c] - mean[c]) * factor[c] + shift[c];
    }
  }
}

// SiLU'(u) = s (1 + u (1 − s)) with s = sigmoid(u).
ANIGEN_KERNEL(void, norm_columns_slopes,
              (const ColumnNorm& norm, const float* __restrict x, const float* __restrict dy, float* __restrict d,
               float* __restrict sums, float* __restrict with_centred),
              (norm, x, dy, d, sums, with_centred)) {
  const float* __restrict mean = norm.mean, * __restrict factor = norm.factor, * __restrict shift = norm.shift;
  const std::int64_t n = norm.channels;
  for (std::int64_t c = 0; c < n; ++c) sums[c] = with_centred[c] = 0.0F;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, dy += n, d += n) {
    if (norm.silu) {
      for (std::int64_t c = 0; c < n; ++c) {
        const float u = (x[c] - mean[c]) * factor[c] + shift[c], s = sigmoid(u);
        d[c] = dy[c] * s * (1.0F + u * (1.0F - s));
      }
    } else {
      for (std::int64_t c = 0; c < n; ++c) d[c] = dy[c];
    }
    for (std::int64_t c = 0; c < n; ++c) {
      sums[c] += d[c];
      with_centred[c] += d[c] * (x[c] - mean[c]);
    }
  }
}

ANIGEN_KERNEL(void, norm_columns_backward,
              (std::int64_t rows, std::int64_t channels, const float* __restrict x, const float* __restrict mean,
               const ColumnGradient& gradient, float* __restrict d),
              (rows, channels, x, mean, gradient, d)) {
  const float *__restrict of_slope = gradient.of_slope, *__restrict of_centred = gradient.of_centred,
              *__restrict constant = gradient.constant;
  for (std::int64_t r = 0; r < rows; ++r, x += channels, d += channels) {
    for (std::int64_t c = 0; c < channels; ++c)
      d[c] = d[c] * of_slope[c] + (x[c] - mean[c]) * of_centred[c] + constant[c];
  }
}

}  // namespace anigen::nn::kernels

namespace anigen::nn {

namespace {

ANIGEN_KERNEL(void, add_rows,
              (const float* __restrict x, std::int64_t stride, std::int64_t rows, std::int64_t columns,
               float* __restrict sums),
              (x, stride, rows, columns, sums)) {
  for (std::int64_t r = 0; r < rows; ++r, x += stride) {
    for (std::int64_t c = 0; c < columns; ++c) sums[c] += x[c];
  }
}

}  // namespace

torch::Tensor sum_of_rows(const torch::Tensor& x) {
  if (!x.is_cpu() || x.scalar_type() != torch::kFloat32 || x.size(1) == 0) return x.sum(0);
  const torch::Tensor rows = x.stride(1) == 1 ? x : x.contiguous();
  const std::int64_t columns = rows.size(1);
  const std::vector<RowBlock> blocks = row_blocks({rows.size(0)}, columns);
  const torch::Tensor parts = torch::zeros({static_cast<std::int64_t>(blocks.size()), columns}, rows.options());
  for_each_block(blocks, [&](const RowBlock& block, std::int64_t b) {
    add_rows(rows.data_ptr<float>() + block.first * rows.stride(0), rows.stride(0), block.count, columns,
             parts.data_ptr<float>() + b * columns);
  });
  return sums_of_items(blocks, parts, 1)[0];
}

}  // namespace anigen::nn
