#include "anigen/models/anymate/connectivity.h"

#include <string>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr double kLogFloor = 1e-6;

}  // namespace

Tensor connectivity_loss(const Tensor& logits, const Tensor& parents) {
  require_shape(logits, {-1, -1, -1}, "logits");
  const std::int64_t joints = logits.size(1);
  require_shape(logits, {-1, joints, joints}, "logits");
  require_shape(parents, {logits.size(0), -1, joints}, "conns");
  require(parents.size(1) >= joints, "conns", "has fewer rows than there are joints");
  const Tensor truth = parents.narrow(1, 0, joints).to(logits.dtype());
  return -(truth * (torch::softmax(logits, -1) + kLogFloor).log()).sum(-1).mean();
}

Tensor likeliest_parents(const Tensor& logits) {
  require(logits.defined() && (logits.dim() == 2 || logits.dim() == 3) && logits.size(-1) == logits.size(-2), "logits",
          "must be [J, J] or [B, J, J]");
  return logits.argmax(-1);
}

Tensor bones_of(const Tensor& joints, const Tensor& parents) {
  require_shape(joints, {-1, 3}, "joints");
  const std::int64_t count = joints.size(0);
  require_shape(parents, {count}, "parents");
  const Tensor parent = parents.to(joints.device(), torch::kInt64);
  require(count == 0 || (parent.min().item<std::int64_t>() >= 0 && parent.max().item<std::int64_t>() < count),
          "parents", "holds an index outside [0, " + std::to_string(count) + ")");
  const Tensor children = (parent != torch::arange(count, parent.options())).nonzero().flatten();
  return torch::cat({joints.index_select(0, parent.index_select(0, children)), joints.index_select(0, children)}, 1);
}

}  // namespace anigen::models::anymate
