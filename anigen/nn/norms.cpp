#include "anigen/nn/norms.h"

#include <cmath>
#include <vector>

#include "anigen/nn/kernels/activations.h"
#include "anigen/nn/kernels/heads.h"
#include "anigen/nn/kernels/rows.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

Tensor layer_norm(const Tensor& x, double eps) {
  const torch::Dtype dtype = dtype_of(x);
  const Tensor normed = torch::layer_norm(x.to(accumulation_dtype(dtype)), {x.size(-1)}, {}, {}, eps);
  return normed.to(dtype);
}

Tensor unit_length(const Tensor& x) { return x / x.norm(2, -1, /*keepdim=*/true).clamp_min(1e-12); }

AffineLayerNormImpl::AffineLayerNormImpl(std::int64_t channels, double eps) : eps_(eps) {
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

Tensor AffineLayerNormImpl::forward(const Tensor& x) { return affine_norm(x, weight, bias, eps_); }

Tensor AffineLayerNormImpl::activated(const Tensor& x) { return norm_silu(x, weight, bias, eps_); }

namespace {

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
    const variable_list saved = saved_once(*context, "the norm of queries and keys");
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

class NormSiluFunction : public torch::autograd::Function<NormSiluFunction> {
 public:
  // @param x [N, C], contiguous @param weight, bias [C], contiguous
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& weight, const Tensor& bias,
                        double eps) {
    RECORD_USER_SCOPE("elementwise and copies: norm, SiLU");
    const std::int64_t rows = x.size(0), channels = x.size(1);
    const Tensor y = torch::empty_like(x), statistics = torch::empty({2, rows}, x.options());
    float *const means = statistics.data_ptr<float>(), *const rstds = means + rows, *const out = y.data_ptr<float>();
    const float *const in = x.data_ptr<float>(), *const factor = weight.data_ptr<float>();
    const float* const shift = bias.data_ptr<float>();
    for_each_block(row_blocks({rows}, channels), [&](const RowBlock& block, std::int64_t) {
      const std::int64_t at = block.first * channels;
      kernels::norm_silu_rows({block.count, channels, 0.0F, static_cast<float>(eps)}, in + at, factor, shift, out + at,
                              means + block.first, rstds + block.first);
    });
    context->save_for_backward({x, weight, bias, statistics});
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: norm, SiLU");
    const variable_list saved = saved_once(*context, "layer norm with SiLU");
    const Tensor &x = saved[0], &statistics = saved[3], dy = gradients[0].contiguous();
    const std::int64_t rows = x.size(0), channels = x.size(1);
    const std::vector<RowBlock> blocks = row_blocks({rows}, channels);
    const auto parts = static_cast<std::int64_t>(blocks.size());
    const Tensor dx = torch::empty_like(x), sums = torch::zeros({2, parts, channels}, x.options());
    const float *const means = statistics.data_ptr<float>(), *const rstds = means + rows;
    const float *const in = x.data_ptr<float>(), *const slopes = dy.data_ptr<float>();
    const float *const factor = saved[1].data_ptr<float>(), *const shift = saved[2].data_ptr<float>();
    float *const out = dx.data_ptr<float>(), *const d_factors = sums.data_ptr<float>();
    float* const d_shifts = d_factors + parts * channels;
    for_each_block(blocks, [&](const RowBlock& block, std::int64_t b) {
      const std::int64_t at = block.first * channels;
      kernels::norm_silu_rows_backward({block.count, channels, 0.0F, 0.0F}, in + at, slopes + at, factor, shift,
                                       means + block.first, rstds + block.first, out + at, d_factors + b * channels,
                                       d_shifts + b * channels);
    });
    return {dx, sums_of_items(blocks, sums[0], 1)[0], sums_of_items(blocks, sums[1], 1)[0], Tensor()};
  }
};

bool has_kernel(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const auto is_fp32 = [](const Tensor& t) { return t.is_cpu() && dtype_of(t) == torch::kFloat32; };
  return is_fp32(x) && is_fp32(weight) && is_fp32(bias) && x.dim() >= 1 && x.numel() > 0;
}

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

Tensor norm_silu(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps) {
  if (!has_kernel(x, weight, bias)) return torch::silu(affine_norm(x, weight, bias, eps));
  const std::int64_t channels = x.size(-1);
  TORCH_CHECK(weight.dim() == 1 && bias.dim() == 1 && weight.size(0) == channels && bias.size(0) == channels,
              "layer norm with SiLU: ", channels, " weights and biases are needed, not ", weight.sizes(), " and ",
              bias.sizes());
  const Tensor rows = x.reshape({-1, channels}).contiguous();
  return NormSiluFunction::apply(rows, weight.contiguous(), bias.contiguous(), eps).view(x.sizes());
}

}  // namespace anigen::nn
