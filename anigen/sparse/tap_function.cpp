#include "anigen/sparse/tap_function.h"

#include "anigen/sparse/tap_product.h"

namespace anigen::sparse {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

TapPlan plan_of(bool subdivide) { return subdivide ? subdivision_plan() : submanifold_plan(); }

class TapFunction : public torch::autograd::Function<TapFunction> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& feats, const Tensor& matrices, const Tensor& bias,
                        const Tensor& neighbours, bool subdivide) {
    RECORD_USER_SCOPE("convolution: sparse");
    context->save_for_backward({feats, matrices, neighbours});
    context->saved_data["subdivide"] = subdivide;
    const TapPlan plan = plan_of(subdivide);
    Tensor out = torch::empty({neighbours.size(1) * plan.to_children, matrices.size(2)}, matrices.options());
    out.copy_(bias);
    add_tap_product(plan, neighbours, feats, matrices, out);
    return out.to(nn::dtype_of(feats));
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("convolution: sparse");
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "a sparse convolution can be differentiated once only: its backward pass, under create_graph, would "
                "miss terms");
    const variable_list saved = context->get_saved_variables();
    const Tensor &feats = saved[0], &matrices = saved[1], &neighbours = saved[2], &slopes = gradients[0];
    const TapPlan plan = plan_of(context->saved_data["subdivide"].toBool());
    Tensor d_feats, d_matrices, d_bias;
    if (context->needs_input_grad(0)) {
      Tensor sums = torch::zeros(feats.sizes(), matrices.options());
      add_tap_product(reversed(plan), neighbours, slopes, matrices.transpose(1, 2), sums);
      d_feats = sums.to(nn::dtype_of(feats));
    }
    if (context->needs_input_grad(1)) d_matrices = tap_correlation(plan, neighbours, feats, slopes);
    if (context->needs_input_grad(2)) d_bias = slopes.to(nn::dtype_of(matrices)).sum(0);
    return {d_feats, d_matrices, d_bias, Tensor(), Tensor()};
  }
};

}  // namespace

Tensor tap_function(const Tensor& feats, const Tensor& matrices, const Tensor& bias, const Tensor& neighbours,
                    bool subdivide) {
  return TapFunction::apply(feats, matrices, bias, neighbours, subdivide);
}

}  // namespace anigen::sparse
