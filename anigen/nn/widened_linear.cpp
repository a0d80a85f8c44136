#include "anigen/nn/widened_linear.h"

#include <ATen/Context.h>

#include "anigen/core/kernel_form.h"

namespace anigen::nn {
namespace {

// True if LibTorch multiplies bf16 numbers well here, and ANIGEN_KERNELS asks for nothing narrower.
bool has_bf16_linear() {
#if defined(__x86_64__)
  static const bool has = at::hasMKLDNN() && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
                          __builtin_cpu_supports("avx512dq");
  return has && kernel_form() >= KernelForm::kAvx512;
#else
  static const bool has = at::hasMKLDNN();
  return has;
#endif
}

// x wᵀ in fp32.
class WideProduct : public torch::autograd::Function<WideProduct> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& x, const Tensor& weight) {
    context->save_for_backward({x, weight});
    return torch::matmul(x.to(torch::kFloat32), weight.to(torch::kFloat32).t());
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &weight = saved[1];
    const Tensor dy = gradients[0].reshape({-1, weight.size(0)});
    const Tensor dx = torch::mm(dy, weight.to(torch::kFloat32)).to(x.scalar_type()).view(x.sizes());
    const Tensor rows = x.to(torch::kFloat32).reshape({-1, weight.size(1)});
    return {dx, torch::mm(dy.t(), rows).to(weight.scalar_type())};
  }
};

}  // namespace

bool prefers_widened_linear(const Tensor& x, const Tensor& weight) {
  return x.is_cpu() && x.scalar_type() == torch::kBFloat16 && weight.scalar_type() == torch::kBFloat16 &&
         !has_bf16_linear();
}

Tensor widened_linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const Tensor y = WideProduct::apply(x, weight);
  return (bias.defined() ? y + bias.to(torch::kFloat32) : y).to(x.scalar_type());
}

}  // namespace anigen::nn
