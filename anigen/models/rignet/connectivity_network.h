#pragma once
#include "anigen/models/rignet/bone_network.h"
#include "anigen/models/rignet/root_network.h"

namespace anigen::models::rignet {

struct ConnectivityLogits {
  Tensor bone;  ///< [P], in the order of the input's pairs
  Tensor root;  ///< [ΣJ]
};

/// Both networks of RigNet's connectivity, which share nothing but their input. Keys `bone.*`, `root.*`.
class ConnectivityNetworkImpl : public torch::nn::Module {
 public:
  explicit ConnectivityNetworkImpl(const RignetOptions& options);
  ConnectivityLogits forward(const ConnectivityInput& input) { return {bone_(input), root_(input)}; }

 private:
  BoneNetwork bone_ = nullptr;
  RootNetwork root_ = nullptr;
};
TORCH_MODULE(ConnectivityNetwork);

/// BCE, its mean over all and its mean over the hardest 30 %, added (reference anymate-baselines.md, 9.3).
/// @param logits, truth [N], at least one @return scalar
Tensor hard_binary_loss(const Tensor& logits, const Tensor& truth);

/// Probabilities of one mesh.
struct ConnectivityChances {
  Tensor bone;  ///< [J, J] fp32, symmetric, zero on the diagonal
  Tensor root;  ///< [J] fp32
};
/// @param input of one mesh @return on the CPU, without gradient
ConnectivityChances connectivity_chances(const ConnectivityLogits& logits, const ConnectivityInput& input);

}  // namespace anigen::models::rignet
