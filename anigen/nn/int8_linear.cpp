#include "anigen/nn/int8_linear.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/linear.h"

namespace anigen::nn {

namespace {

constexpr std::int64_t kInt8Rows = 48;        // rounded and multiplied at a time: with a panel they stay in the cache
constexpr std::int64_t kBlocksPerThread = 2;  // fewer blocks of rows than that, and threads share the columns

// @tparam Number float, or bf16 numbers as their 16 bits
template <typename Number>
struct Int8Product {
  const Number* x;
  std::int64_t stride, rows;
  const kernels::Int8Matrix& weight;
  const float* bias;  // [columns, padded to whole panels]
  Number* out;        // [rows, columns]

  std::int64_t blocks() const { return (rows + kInt8Rows - 1) / kInt8Rows; }
  std::int64_t rows_of(std::int64_t block) const { return std::min(kInt8Rows, rows - block * kInt8Rows); }

  void round_block(std::int64_t block, kernels::Int8Rows& rounded) const {
    kernels::round_rows_to_int8(x + block * kInt8Rows * stride, rows_of(block), weight.depth, stride, rounded);
  }

  void multiply_panel(const kernels::Int8Rows& rounded, std::int64_t block, std::int64_t panel, float* tile) const {
    const std::int64_t column = panel * kernels::kInt8PanelColumns;
    kernels::multiply_int8(rounded, rows_of(block), weight, panel, tile);
    kernels::add_bias_to_panel(tile, rows_of(block), std::min(kernels::kInt8PanelColumns, weight.columns - column),
                               bias + column, out + block * kInt8Rows * weight.columns + column, weight.columns);
  }
};

constexpr auto kTileNumbers = static_cast<std::size_t>(kInt8Rows * kernels::kInt8PanelColumns);

// Threads share the rows.
template <typename Number>
void multiply_blocks(const Int8Product<Number>& product) {
  at::parallel_for(0, product.blocks(), 1, [&](std::int64_t begin, std::int64_t end) {
    kernels::Int8Rows rounded;
    kernels::AlignedVector<float> tile(kTileNumbers);
    for (std::int64_t block = begin; block < end; ++block) {
      product.round_block(block, rounded);
      for (std::int64_t panel = 0; panel < product.weight.panels(); ++panel)
        product.multiply_panel(rounded, block, panel, tile.data());
    }
  });
}

// Threads share the columns.
template <typename Number>
void multiply_panels(const Int8Product<Number>& product) {
  std::vector<kernels::Int8Rows> rounded(static_cast<std::size_t>(product.blocks()));
  for (std::int64_t b = 0; b < product.blocks(); ++b) product.round_block(b, rounded[static_cast<std::size_t>(b)]);
  at::parallel_for(0, product.weight.panels(), 1, [&](std::int64_t begin, std::int64_t end) {
    kernels::AlignedVector<float> tile(kTileNumbers);
    for (std::int64_t b = 0; b < product.blocks(); ++b) {
      for (std::int64_t panel = begin; panel < end; ++panel)
        product.multiply_panel(rounded[static_cast<std::size_t>(b)], b, panel, tile.data());
    }
  });
}

template <typename Number>
void multiply(const Int8Product<Number>& product) {
  if (product.blocks() >= kBlocksPerThread * at::get_num_threads()) {
    multiply_blocks(product);
  } else {
    multiply_panels(product);
  }
}

}  // namespace

Tensor int8_linear(const Tensor& x, const kernels::Int8Matrix& weight, const Tensor& bias) {
  TORCH_CHECK(!(at::GradMode::is_enabled() && x.requires_grad()), "8-bit weights record no gradient");
  const torch::Dtype dtype = dtype_of(x);
  TORCH_CHECK(x.is_cpu() && (dtype == torch::kFloat32 || dtype == torch::kBFloat16) && x.size(-1) == weight.depth,
              "a layer of 8-bit weights of ", weight.depth, " channels: input ", x.sizes(), " of ", x.dtype());
  Tensor rows = x.reshape({-1, weight.depth});
  if (rows.stride(1) != 1) rows = rows.contiguous();
  std::vector<std::int64_t> shape = x.sizes().vec();
  shape.back() = weight.columns;
  const Tensor out = torch::empty({rows.size(0), weight.columns}, x.options());
  std::vector<float> start(static_cast<std::size_t>(weight.padded_columns()), 0.0F);
  if (bias.defined()) {
    const Tensor wide = bias.detach().to(torch::kFloat32).contiguous();
    std::copy_n(wide.data_ptr<float>(), weight.columns, start.begin());
  }
  if (dtype == torch::kFloat32) {
    multiply(Int8Product<float>{rows.data_ptr<float>(), rows.stride(0), rows.size(0), weight, start.data(),
                                out.data_ptr<float>()});
  } else {
    multiply(Int8Product<std::uint16_t>{bf16_bits(rows), rows.stride(0), rows.size(0), weight, start.data(),
                                        bf16_bits(out)});
  }
  return out.view(shape);
}

bool quantizes(const LinearImpl& linear) {
  return !linear.is_quantized() && linear.weight.size(0) >= kFewestInt8Width &&
         linear.weight.size(1) >= kFewestInt8Width;
}

void quantize(LinearImpl& linear, const std::string& key) {
  // Without a tensor of the weight's size, which would leave holes between those that stay.
  const Tensor weight = linear.weight.detach();
  if (!std::isfinite(weight.min().item<float>()) || !std::isfinite(weight.max().item<float>()))
    throw InputError("", key, "a number is not finite");
  linear.quantize();
}

}  // namespace anigen::nn
