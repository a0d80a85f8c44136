#include "anigen/nn/rms_norm.h"

#include <cmath>
#include <vector>

#include "anigen/nn/bf16_bits.h"
#include "anigen/nn/head_norm_kernels.h"
#include "anigen/nn/layer_norm.h"
#include "anigen/nn/row_blocks.h"

namespace anigen::nn {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Rows of heads that the kernels can read where they are: parts of a wider projection.
bool has_adjacent_heads(const Tensor& x) {
  return x.dim() == 3 && x.stride(2) == 1 && x.stride(1) == x.size(2) && x.stride(0) >= x.size(1) * x.size(2);
}

kernels::HeadNorm head_norm(const Tensor& x, std::int64_t rows) { return {rows, x.size(1), x.size(2), x.stride(0)}; }

std::vector<RowBlock> head_blocks(const Tensor& x) { return row_blocks({x.size(0)}, x.size(1) * x.size(2)); }

class HeadNormFunction : public torch::autograd::Function<HeadNormFunction> {
 public:
  // @param x [N, H, D] with adjacent heads @param factors [H, D] fp32, contiguous
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& factors) {
    RECORD_USER_SCOPE("elementwise and copies: norm of queries and keys");
    const Tensor y = torch::empty(x.sizes(), x.options());
    const std::int64_t width = x.size(1) * x.size(2), stride = x.stride(0);
    const float* const factor = factors.data_ptr<float>();
    for_each_block(head_blocks(x), [&](const RowBlock& block, std::int64_t) {
      const kernels::HeadNorm norm = head_norm(x, block.count);
      if (dtype_of(x) == torch::kBFloat16) {
        std::vector<float> scratch(static_cast<std::size_t>(x.size(2)));
        kernels::rms_norm_rows(norm, bf16_bits(x) + block.first * stride, factor, bf16_bits(y) + block.first * width,
                               scratch.data());
      } else {
        kernels::rms_norm_rows(norm, x.data_ptr<float>() + block.first * stride, factor,
                               y.data_ptr<float>() + block.first * width);
      }
    });
    context->save_for_backward({x, factors});
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: norm of queries and keys");
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "the norm of queries and keys can be differentiated once only: its backward pass, under create_graph, "
                "would miss terms");
    const variable_list saved = context->get_saved_variables();
    const Tensor x = saved[0].to(torch::kFloat32), &factors = saved[1];
    const Tensor dy = gradients[0].to(torch::kFloat32).contiguous();
    const Tensor dx = torch::empty(x.sizes(), dy.options());
    const std::vector<RowBlock> blocks = head_blocks(x);
    const std::int64_t width = x.size(1) * x.size(2);
    const Tensor sums = torch::zeros({static_cast<std::int64_t>(blocks.size()), width}, dy.options());
    for_each_block(blocks, [&](const RowBlock& block, std::int64_t b) {
      kernels::rms_norm_rows_backward(head_norm(x, block.count), x.data_ptr<float>() + block.first * x.stride(0),
                                      dy.data_ptr<float>() + block.first * width, factors.data_ptr<float>(),
                                      dx.data_ptr<float>() + block.first * width, sums.data_ptr<float>() + b * width);
    });
    return {dx.to(dtype_of(saved[0])), sums_of_items(blocks, sums, 1).view(factors.sizes())};
  }
};

}  // namespace

MultiHeadRmsNormImpl::MultiHeadRmsNormImpl(std::int64_t head_channels, std::int64_t num_heads) {
  gamma = register_parameter("gamma", torch::ones({num_heads, head_channels}));
}

Tensor MultiHeadRmsNormImpl::forward(const Tensor& x) {
  const torch::Dtype dtype = dtype_of(x), wide = accumulation_dtype(dtype);
  const Tensor factors = gamma.to(wide) * std::sqrt(static_cast<double>(gamma.size(1)));
  TORCH_CHECK(x.dim() >= 2 && x.size(-1) == gamma.size(1) && x.size(-2) == gamma.size(0), "norm of ", gamma.size(0),
              " heads of ", gamma.size(1), " channels: input ", x.sizes());
  if (x.is_cpu() && gamma.is_cpu() && (dtype == torch::kFloat32 || dtype == torch::kBFloat16)) {
    Tensor rows = x.dim() == 3 ? x : x.reshape({-1, x.size(-2), x.size(-1)});
    if (!has_adjacent_heads(rows)) rows = rows.contiguous();
    return HeadNormFunction::apply(rows, factors.contiguous()).view(x.sizes());
  }
  return (unit_length(x.to(wide)) * factors).to(dtype);
}

}  // namespace anigen::nn
