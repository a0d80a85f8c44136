#include "anigen/flow/condition_dropout.h"

#include <vector>

namespace anigen::flow {

Tensor draw_condition_dropout(std::int64_t count, double probability, at::Generator generator) {
  // In double, so that probability 1 drops every item and 0 none.
  return torch::rand({count}, generator, torch::kFloat64) < probability;
}

Tensor replace_condition(const Tensor& condition, const Tensor& dropped, const Tensor& negative) {
  TORCH_CHECK(dropped.dim() == 1 && dropped.size(0) == condition.size(0), "condition dropout of ", condition.size(0),
              " items with a mask of shape ", dropped.sizes());
  std::vector<std::int64_t> shape(static_cast<std::size_t>(condition.dim()), 1);
  shape[0] = dropped.size(0);
  const Tensor mask = dropped.to(condition.device(), torch::kBool).view(shape);
  return torch::where(mask, negative.defined() ? negative : torch::zeros_like(condition), condition);
}

}  // namespace anigen::flow
