#include "anigen/nn/int8_linear.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <memory>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/linear.h"

namespace anigen::nn {

namespace {

constexpr std::int64_t kInt8Rows = 48;        // rounded and multiplied at a time: with a panel they stay in the cache
constexpr std::int64_t kBlocksPerThread = 2;  // fewer blocks of rows than that, and threads share the columns

struct Int8Product {
  const float* x;
  std::int64_t stride, rows;
  const kernels::Int8Matrix& weight;
  const float* bias;  // nullptr: none
  float* out;
};

// Columns of one panel for rounded rows that begin at row `first` of the product.
void multiply_panel_int8(const Int8Product& product, const kernels::Int8Rows& rounded, std::int64_t first,
                         std::int64_t count, std::int64_t panel, float* tile) {
  constexpr std::int64_t kWidth = kernels::kInt8PanelColumns;
  const std::int64_t columns = product.weight.columns, column = panel * kWidth;
  const std::int64_t width = std::min(kWidth, columns - column);
  kernels::multiply_int8(rounded, count, product.weight, panel, tile);
  for (std::int64_t r = 0; r < count; ++r) {
    const float* from = tile + r * kWidth;
    float* to = product.out + (first + r) * columns + column;
    if (product.bias == nullptr) {
      std::copy_n(from, width, to);
    } else {
      for (std::int64_t c = 0; c < width; ++c) to[c] = from[c] + product.bias[column + c];
    }
  }
}

void multiply_blocks(const Int8Product& product, std::int64_t blocks) {
  at::parallel_for(0, blocks, 1, [&](std::int64_t begin, std::int64_t end) {
    kernels::Int8Rows rounded;
    std::vector<float> tile(static_cast<std::size_t>(kInt8Rows * kernels::kInt8PanelColumns));
    for (std::int64_t first = begin * kInt8Rows; first < std::min(product.rows, end * kInt8Rows); first += kInt8Rows) {
      const std::int64_t count = std::min(kInt8Rows, product.rows - first);
      kernels::round_rows_to_int8(product.x + first * product.stride, count, product.weight.depth, product.stride,
                                  rounded);
      for (std::int64_t panel = 0; panel < product.weight.panels(); ++panel)
        multiply_panel_int8(product, rounded, first, count, panel, tile.data());
    }
  });
}

void multiply_panels(const Int8Product& product, std::int64_t blocks) {
  std::vector<kernels::Int8Rows> rounded(static_cast<std::size_t>(blocks));
  for (std::int64_t b = 0; b < blocks; ++b) {
    const std::int64_t first = b * kInt8Rows, count = std::min(kInt8Rows, product.rows - first);
    kernels::round_rows_to_int8(product.x + first * product.stride, count, product.weight.depth, product.stride,
                                rounded[static_cast<std::size_t>(b)]);
  }
  at::parallel_for(0, product.weight.panels(), 1, [&](std::int64_t begin, std::int64_t end) {
    std::vector<float> tile(static_cast<std::size_t>(kInt8Rows * kernels::kInt8PanelColumns));
    for (std::int64_t b = 0; b < blocks; ++b) {
      const std::int64_t first = b * kInt8Rows, count = std::min(kInt8Rows, product.rows - first);
      for (std::int64_t panel = begin; panel < end; ++panel)
        multiply_panel_int8(product, rounded[static_cast<std::size_t>(b)], first, count, panel, tile.data());
    }
  });
}

}  // namespace

Tensor int8_linear(const Tensor& x, const kernels::Int8Matrix& weight, const Tensor& bias) {
  TORCH_CHECK(!(at::GradMode::is_enabled() && x.requires_grad()), "8-bit weights record no gradient");
  TORCH_CHECK(x.is_cpu() && dtype_of(x) == torch::kFloat32 && x.size(-1) == weight.depth,
              "a layer of 8-bit weights of ", weight.depth, " channels: input ", x.sizes());
  Tensor rows = x.reshape({-1, weight.depth});
  if (rows.stride(1) != 1) rows = rows.contiguous();
  std::vector<std::int64_t> shape = x.sizes().vec();
  shape.back() = weight.columns;
  const Tensor out = torch::empty({rows.size(0), weight.columns}, x.options()),
               start = bias.defined() ? bias.to(torch::kFloat32).contiguous() : Tensor();
  const Int8Product product{
      rows.data_ptr<float>(), rows.stride(0), rows.size(0), weight, start.defined() ? start.data_ptr<float>() : nullptr,
      out.data_ptr<float>()};
  const std::int64_t blocks = (product.rows + kInt8Rows - 1) / kInt8Rows;
  if (blocks >= kBlocksPerThread * at::get_num_threads()) {
    multiply_blocks(product, blocks);
  } else if (blocks > 0) {
    multiply_panels(product, blocks);
  }
  return out.view(shape);
}

std::int64_t quantize_linears(torch::nn::Module& module) {
  std::int64_t rounded = 0;
  for (const auto& item : module.named_modules()) {
    auto* const linear = dynamic_cast<LinearImpl*>(item.value().get());
    if (linear == nullptr || linear->is_quantized() || linear->weight.size(0) < kFewestInt8Width ||
        linear->weight.size(1) < kFewestInt8Width)
      continue;
    if (!linear->weight.is_cpu()) throw NotSupportedError("", "", "8-bit weights on a GPU; use bf16 or fp16");
    if (!torch::isfinite(linear->weight).all().item<bool>())
      throw InputError("", item.key() + ".weight", "a number is not finite");
    linear->quantize();
    ++rounded;
  }
  return rounded;
}

}  // namespace anigen::nn
