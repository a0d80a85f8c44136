#include "anigen/nn/gelu.h"

#include <ATen/Parallel.h>

#include "anigen/nn/gelu_kernels.h"

namespace anigen::nn {
namespace {

constexpr std::int64_t kGrain = 16384;  // fewer values than this cost less than starting a second thread

class VectorGelu : public torch::autograd::Function<VectorGelu> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& x) {
    RECORD_USER_SCOPE("elementwise and copies: gelu");
    context->save_for_backward({x});
    Tensor y = torch::empty_like(x);
    const float* in = x.data_ptr<float>();
    float* out = y.data_ptr<float>();
    at::parallel_for(0, x.numel(), kGrain, [&](std::int64_t begin, std::int64_t end) {
      kernels::gelu_forward(in + begin, out + begin, end - begin);
    });
    return y;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: gelu");
    const Tensor x = context->get_saved_variables()[0];
    const Tensor dy = gradients[0].contiguous();
    Tensor dx = torch::empty_like(x);
    const float *in = x.data_ptr<float>(), *grad = dy.data_ptr<float>();
    float* out = dx.data_ptr<float>();
    at::parallel_for(0, x.numel(), kGrain, [&](std::int64_t begin, std::int64_t end) {
      kernels::gelu_backward(in + begin, grad + begin, out + begin, end - begin);
    });
    return {dx};
  }
};

}  // namespace

Tensor gelu_tanh(const Tensor& x) {
  if (!x.is_cpu() || dtype_of(x) != torch::kFloat32) return torch::gelu(x, "tanh");
  return VectorGelu::apply(x.contiguous());
}

}  // namespace anigen::nn
