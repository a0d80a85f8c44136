#pragma once
#include "anigen/models/rignet/connectivity_input.h"
#include "anigen/models/rignet/point_layers.h"
#include "anigen/models/rignet/shape_code.h"

namespace anigen::models::rignet {

/// BoneNet: whether there is a bone between two joints, from codes of the shape, of all joints and of the pair: both
/// positions, their distance, the share of the way inside (reference anymate-baselines.md, 9.3). While training each
/// pair is looked at in an order drawn from LibTorch's generator; afterwards (ours) in both, and logits are their mean,
/// so that the answer does not depend on how joints are numbered.
/// Keys `shape.*`, `near.*`, `far.*`, `joints.*`, `pair.*`, `head.*`, `last.*`.
class BoneNetworkImpl : public torch::nn::Module {
 public:
  explicit BoneNetworkImpl(const RignetOptions& options);
  Tensor forward(const ConnectivityInput& input);  ///< @return [P] logits

 private:
  Tensor judged(const Tensor& codes, const Tensor& from, const Tensor& to, const Tensor& inside);

  ShapeCode shape_ = nullptr;
  SetAbstraction near_ = nullptr, far_ = nullptr;
  DenseStack joints_ = nullptr, pair_ = nullptr, head_ = nullptr;
  torch::nn::Dropout dropout_ = nullptr;
  nn::Linear last_ = nullptr;
};
TORCH_MODULE(BoneNetwork);

}  // namespace anigen::models::rignet
