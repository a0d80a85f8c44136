#pragma once
#include "anigen/models/rignet/connectivity_input.h"
#include "anigen/models/rignet/point_layers.h"
#include "anigen/models/rignet/shape_code.h"

namespace anigen::models::rignet {

/// RootNet: which joint is the root, from the shape's code and from each joint among the others, beginning with its
/// |x| (reference anymate-baselines.md, 9.3). The reference gives no widths of the way back from the code of all joints
/// to each: they are 256, 128 and 128 here, and the way up is BoneNet's without its last two layers.
/// Keys `shape.*`, `near.*`, `far.*`, `all.*`, `back_far.*`, `back_near.*`, `back_joints.*`, `head.*`, `last.*`.
class RootNetworkImpl : public torch::nn::Module {
 public:
  explicit RootNetworkImpl(const RignetOptions& options);
  Tensor forward(const ConnectivityInput& input);  ///< @return [ΣJ] logits

 private:
  ShapeCode shape_ = nullptr;
  SetAbstraction near_ = nullptr, far_ = nullptr;
  DenseStack all_ = nullptr, back_far_ = nullptr, back_near_ = nullptr, back_joints_ = nullptr, head_ = nullptr;
  nn::Linear last_ = nullptr;
};
TORCH_MODULE(RootNetwork);

}  // namespace anigen::models::rignet
