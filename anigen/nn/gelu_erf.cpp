#include "anigen/nn/gelu_erf.h"

namespace anigen::nn {

namespace {

class ErfGelu : public torch::autograd::Function<ErfGelu> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& x) {
    context->save_for_backward({x});
    return torch::gelu(x);
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    return {at::gelu_backward(gradients[0].contiguous(), context->get_saved_variables()[0])};
  }
};

}  // namespace

Tensor gelu_erf(const Tensor& x) { return ErfGelu::apply(x.contiguous()); }

}  // namespace anigen::nn
