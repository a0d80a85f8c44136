#include "anigen/models/rignet/graph_unit.h"

#include <string>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {

EdgeMessageImpl::EdgeMessageImpl(std::int64_t in, std::int64_t out) : in_(in) {
  first_ = register_module("first", nn::Linear(2 * in, out));
  norm_ = register_module("norm", torch::nn::BatchNorm1d(out));
  second_ = register_module("second", ReluNorm(out, out));
}

Tensor EdgeMessageImpl::forward(const Tensor& x, const EdgeSet& edges) {
  anymate::require_shape(x, {-1, in_}, "x");
  const Tensor of_target = first_->weight.narrow(1, 0, in_), of_way = first_->weight.narrow(1, in_, in_);
  const Tensor at_target = torch::linear(x, of_target - of_way, first_->bias), at_source = torch::linear(x, of_way);
  const Tensor messages = batch_normed(norm_, torch::relu(edge_sums(at_target, at_source, edges)));
  return run_maxima(second_(messages), edges.offsets);
}

GraphUnitImpl::GraphUnitImpl(std::int64_t in, std::int64_t out) {
  anymate::require(out % 2 == 0, "width", "of a unit must be even");
  ring_ = register_module("ring", EdgeMessage(in, out / 2));
  ball_ = register_module("ball", EdgeMessage(in, out / 2));
  mix_ = register_module("mix", ReluNorm(out, out));
}

Tensor GraphUnitImpl::forward(const Tensor& x, const MeshGraph& graph) {
  return mix_(torch::cat({ring_(x, graph.ring), ball_(x, graph.ball)}, 1));
}

GraphStackImpl::GraphStackImpl(const std::vector<std::int64_t>& widths) {
  for (std::size_t i = 0; i + 1 < widths.size(); ++i) {
    units_.push_back(register_module(std::to_string(i), GraphUnit(widths[i], widths[i + 1])));
  }
}

Tensor GraphStackImpl::forward(Tensor x, const MeshGraph& graph) {
  std::vector<Tensor> all;
  for (GraphUnit& unit : units_) {
    x = unit(x, graph);
    all.push_back(x);
  }
  return torch::cat(all, 1);
}

}  // namespace anigen::models::rignet
