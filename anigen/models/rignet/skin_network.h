#pragma once
#include "anigen/models/rignet/graph_unit.h"
#include "anigen/models/rignet/options.h"

namespace anigen::models::rignet {

inline constexpr std::int64_t kBoneNumbers = 8;  ///< head, tail, 1/D, whether it is a tip

/// The bones nearest to each vertex, which are those that RigNet weighs there. Nearest first.
struct BoneSlots {
  Tensor bones;     ///< [V, S] int64; -1 where there are fewer bones
  Tensor features;  ///< [V, S · kBoneNumbers] fp32, zero where there is none

  BoneSlots to(torch::Device device) const { return {bones.to(device), features.to(device)}; }
};

/// SkinNet (reference anymate-baselines.md, 9.3): vertices beside the numbers of their nearest bones through 128 and
/// 64, a unit of 512, a code of 1024 for the mesh, two units of 256, and both together through 1024 and 512 to a logit
/// per slot. Keys `input.*`, `first.*`, `whole.*`, `second.*`, `third.*`, `head.*`, `last.*`.
class SkinNetworkImpl : public torch::nn::Module {
 public:
  explicit SkinNetworkImpl(const RignetOptions& options);
  /// @return [V, S] logits, -1e8 for slots without a bone @throws InputError for shapes
  Tensor forward(const MeshGraph& graph, const BoneSlots& slots);

 private:
  std::int64_t slots_;
  DenseStack input_ = nullptr, whole_ = nullptr, head_ = nullptr;
  GraphUnit first_ = nullptr, second_ = nullptr, third_ = nullptr;
  nn::Linear last_ = nullptr;
};
TORCH_MODULE(SkinNetwork);

/// Cross entropy of the softmax over slots with the true weights of the slots, divided by their sum; vertices whose
/// slots hold no weight are left out. Mean over the others, zero without any.
/// @param logits, weights [V, S] @return scalar @throws InputError for shapes
Tensor skin_slot_loss(const Tensor& logits, const Tensor& weights);

/// Shares of slots as shares of bones. @param shares [V, S] @param slots BoneSlots::bones @return [V, bones]
Tensor scattered_to_bones(const Tensor& shares, const Tensor& slots, std::int64_t bones);

/// What RigNet does to predicted weights: each row becomes the mean of its neighbours' along mesh edges, without its
/// own; entries below `least` of the row's largest go; rows are divided by their sums. A vertex without neighbours
/// keeps its row. @param weights [V, K] @param ring of MeshGraph, each vertex being among its own sources
/// @return [V, K] @throws InputError for shapes
Tensor cleaned_weights(const Tensor& weights, const EdgeSet& ring, double least);

}  // namespace anigen::models::rignet
