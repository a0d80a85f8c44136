#include "anigen/models/rignet/skin_network.h"

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

constexpr double kNoBone = -1e8, kLeastSum = 1e-10;

}  // namespace

SkinNetworkImpl::SkinNetworkImpl(const RignetOptions& options) : slots_(options.bones) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const auto stack = [](std::vector<std::int64_t> widths) { return DenseStack(widths); };
  input_ = register_module("input", stack({3 + slots_ * kBoneNumbers, wide(128), wide(64)}));
  first_ = register_module("first", GraphUnit(wide(64), wide(512)));
  whole_ = register_module("whole", stack({wide(512), wide(512), wide(1024)}));
  second_ = register_module("second", GraphUnit(wide(512), wide(256)));
  third_ = register_module("third", GraphUnit(wide(256), wide(256)));
  head_ = register_module("head", stack({wide(1024) + wide(256), wide(1024), wide(512)}));
  last_ = register_module("last", nn::Linear(wide(512), slots_));
}

Tensor SkinNetworkImpl::forward(const MeshGraph& graph, const BoneSlots& slots) {
  anymate::require_shape(slots.bones, {graph.vertices.size(0), slots_}, "slots");
  anymate::require_shape(slots.features, {graph.vertices.size(0), slots_ * kBoneNumbers}, "features");
  const Tensor seen = first_(input_(torch::cat({graph.vertices, slots.features}, 1)), graph);
  const Tensor code = spread(run_maxima(whole_(seen), graph.starts), graph.starts);
  const Tensor local = third_(second_(seen, graph), graph);
  const Tensor logits = last_(head_(torch::cat({code, local}, 1)));
  return logits.masked_fill(slots.bones < 0, kNoBone);
}

Tensor skin_slot_loss(const Tensor& logits, const Tensor& weights) {
  anymate::require_shape(logits, {-1, -1}, "logits");
  anymate::require_shape(weights, logits.sizes().vec(), "weights");
  const Tensor sums = weights.sum(1, true);
  const Tensor counts = (sums > kLeastSum).to(logits.scalar_type());
  const Tensor truth = weights / sums.clamp_min(kLeastSum) * counts;
  return -(truth * torch::log_softmax(logits, 1)).sum() / counts.sum().clamp_min(1.0);
}

Tensor scattered_to_bones(const Tensor& shares, const Tensor& slots, std::int64_t bones) {
  anymate::require_shape(shares, slots.sizes().vec(), "shares");
  // What is in no bone's slot goes to a column that is dropped.
  const Tensor columns = torch::where(slots < 0, torch::full_like(slots, bones), slots);
  return torch::zeros({shares.size(0), bones + 1}, shares.options())
      .scatter_add(1, columns, shares)
      .narrow(1, 0, bones);
}

Tensor cleaned_weights(const Tensor& weights, const EdgeSet& ring, double least) {
  anymate::require_shape(weights, {ring.targets(), -1}, "weights");
  const Tensor targets = run_of_rows(ring.offsets);
  const Tensor sums = torch::zeros_like(weights).index_add(0, targets, weights.index_select(0, ring.sources)) - weights;
  const Tensor neighbours = (ring.offsets.diff() - 1).unsqueeze(1);
  Tensor rows = torch::where(neighbours > 0, sums / neighbours.clamp_min(1), weights);
  rows = rows.clamp_min(0.0);  // differences of sums may come out just below
  rows = rows.masked_fill(rows < least * rows.amax(1, true), 0.0);
  return rows / rows.sum(1, true).clamp_min(kLeastSum);
}

}  // namespace anigen::models::rignet
