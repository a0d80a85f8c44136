#pragma once
#include <algorithm>
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/torch.h"

/// Rows of one head of a tensor [rows, H, D] of type T, and the fp32 scratch memory that attention works on.

/// Norms of the heads of rows of fp32 numbers or of bf16 numbers as their 16 bits, computed in fp32; one thread, no
/// allocation.

namespace anigen::nn {

/// One head from some row on; its channels are adjacent.
template <typename T>
struct HeadRows {
  HeadRows(const Tensor& x, std::int64_t head, std::int64_t row)
      : values(x.data_ptr<T>() + head * x.stride(1) + row * x.stride(0)), stride(x.stride(0)) {}
  T* values;
  std::int64_t stride;
};

/// Rows as fp32, with zeros from the last channel to the stride of the block, and in the rows up to `filled_rows`.
template <typename T>
void read_rows(const HeadRows<T>& from, std::int64_t rows, std::int64_t channels, std::int64_t filled_rows,
               const products::Block& to) {
  for (std::int64_t r = 0; r < rows; ++r) {
    const T* in = from.values + r * from.stride;
    float* out = to.values + r * to.stride;
    for (std::int64_t c = 0; c < channels; ++c) out[c] = static_cast<float>(in[c]);
    std::fill(out + channels, out + to.stride, 0.0F);
  }
  std::fill(to.values + rows * to.stride, to.values + filled_rows * to.stride, 0.0F);
}

template <typename T>
void write_rows(const products::Block& from, std::int64_t rows, std::int64_t channels, const HeadRows<T>& to) {
  for (std::int64_t r = 0; r < rows; ++r) {
    const float* in = from.values + r * from.stride;
    T* out = to.values + r * to.stride;
    for (std::int64_t c = 0; c < channels; ++c) out[c] = static_cast<T>(in[c]);
  }
}

template <typename T>
void add_rows(products::RowsAhead& ahead, const HeadRows<T>& rows, std::int64_t count, std::int64_t channels) {
  constexpr auto kSize = static_cast<std::int64_t>(sizeof(T));
  ahead.add(rows.values, count, rows.stride * kSize, channels * kSize);
}

/// dots[r] = Σ a(r, c) b(r, c), summed in fp32.
template <typename T>
void dot_rows(const HeadRows<T>& a, const HeadRows<T>& b, std::int64_t rows, std::int64_t channels, float* dots) {
  for (std::int64_t r = 0; r < rows; ++r) {
    const T *x = a.values + r * a.stride, *y = b.values + r * b.stride;
    float lanes[products::kLanes] = {};  // partial sums side by side: compilers keep the order of additions
    std::int64_t c = 0;
    for (; c + products::kLanes <= channels; c += products::kLanes) {
      for (std::int64_t l = 0; l < products::kLanes; ++l)
        lanes[l] += static_cast<float>(x[c + l]) * static_cast<float>(y[c + l]);
    }
    for (; c < channels; ++c) lanes[0] += static_cast<float>(x[c]) * static_cast<float>(y[c]);
    dots[r] = 0.0F;
    for (const float lane : lanes) dots[r] += lane;
  }
}

/// Memory of a thread for a matrix as large as any task needs it.
class ScratchMatrix {
 public:
  ScratchMatrix(std::int64_t rows, std::int64_t columns)
      : memory_(torch::empty({rows * columns}, torch::kFloat32)), values_(memory_.data_ptr<float>()) {}
  float* values() const { return values_; }
  products::Block with_stride(std::int64_t stride) const { return {values_, stride}; }

 private:
  Tensor memory_;
  float* values_;
};

}  // namespace anigen::nn

namespace anigen::nn::kernels {

/// Rows of heads of adjacent channels, the rows of x at a distance and those of the others dense.
struct HeadNorm {
  std::int64_t rows, heads, channels, x_stride;
};

/// y = x / max(‖x‖₂, 1e-12) · factors, per row and head @param factors [H, D]
void rms_norm_rows(const HeadNorm& norm, const float* x, const float* factors, float* y);
void rms_norm_rows(const HeadNorm& norm, const std::uint16_t* x, const float* factors, std::uint16_t* y,
                   float* scratch);

/// Adds to d_factors, [H, D]. @param dx dense
void rms_norm_rows_backward(const HeadNorm& norm, const float* x, const float* dy, const float* factors, float* dx,
                            float* d_factors);

}  // namespace anigen::nn::kernels
