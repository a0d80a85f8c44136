#include "anigen/models/recompute.h"

#include <algorithm>
#include <utility>

namespace anigen::models {
namespace {

using torch::Tensor;
using RecomputedPart = std::function<Tensor(const std::vector<Tensor>&)>;

// A function as a value that an AutogradContext can keep.
struct KeptPart : torch::CustomClassHolder {
  explicit KeptPart(RecomputedPart kept) : part(std::move(kept)) {}
  RecomputedPart part;
};

struct RecomputedCall {
  RecomputedPart part;
  Tensor output;  // when it is known already; detached
};

class Recompute : public torch::autograd::Function<Recompute> {
 public:
  // `anchor` requires a gradient, so that the backward pass runs for the parameters also when no input needs one.
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& anchor, const RecomputedCall& call,
                        const at::TensorList& inputs) {
    static_cast<void>(anchor);
    context->saved_data["part"] = c10::IValue::make_capsule(c10::make_intrusive<KeptPart>(call.part));
    context->save_for_backward(inputs.vec());
    if (call.output.defined()) return call.output;
    return call.part(inputs.vec());  // autograd switches recording off around forward()
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto kept = c10::static_intrusive_pointer_cast<KeptPart>(context->saved_data["part"].toCapsule());
    std::vector<Tensor> inputs;
    for (const Tensor& saved : context->get_saved_variables()) {
      Tensor input = saved.detach();
      input.set_requires_grad(saved.requires_grad());
      inputs.push_back(input);
    }
    Tensor output;
    {
      const torch::AutoGradMode with_grad(true);
      output = kept->part(inputs);
    }
    if (output.requires_grad()) torch::autograd::backward({output}, {gradients[0]});
    torch::autograd::variable_list result = {Tensor(), Tensor()};
    for (const Tensor& input : inputs) result.push_back(input.requires_grad() ? input.grad() : Tensor());
    return result;
  }
};

}  // namespace

Tensor recomputed(const std::vector<Tensor>& inputs, const RecomputedPart& part) {
  RecomputedCall call{part, {}};
  const auto wants_gradient = [](const Tensor& input) { return input.requires_grad(); };
  if (std::none_of(inputs.begin(), inputs.end(), wants_gradient)) {
    // Only the part knows its parameters: whether one of them wants a gradient shows in what it returns. If none does,
    // nothing was kept; else what was kept goes with this output.
    const Tensor output = part(inputs);
    if (!output.requires_grad()) return output;
    call.output = output.detach();
  }
  const Tensor anchor = torch::zeros({1}, torch::requires_grad());
  return Recompute::apply(anchor, call, at::TensorList(inputs));
}

}  // namespace anigen::models
