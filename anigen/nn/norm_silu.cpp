#include "anigen/nn/norm_silu.h"

#include <vector>

#include "anigen/nn/modulated_rows.h"
#include "anigen/nn/norm_silu_kernels.h"
#include "anigen/nn/row_blocks.h"

namespace anigen::nn {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

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
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "layer norm with SiLU can be differentiated once only: its backward pass, ",
                "under create_graph, would miss terms");
    const variable_list saved = context->get_saved_variables();
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
