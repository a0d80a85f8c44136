#pragma once
#include "anigen/models/rignet/graph_unit.h"
#include "anigen/models/rignet/options.h"

namespace anigen::models::rignet {

/// Numbers for each vertex of a mesh, seen together with the whole: JointNet with three channels, MaskNet with one
/// (reference anymate-baselines.md, 9.3). Units of 64, 256 and 512, their outputs to one code of 1024 for the mesh,
/// beside which each vertex passes 1024 and 256 and, after dropout, a linear map without activation.
/// Keys `units.*`, `whole.*`, `head.*`, `last.*`.
class VertexNetworkImpl : public torch::nn::Module {
 public:
  VertexNetworkImpl(const RignetOptions& options, std::int64_t channels);
  Tensor forward(const MeshGraph& graph);  ///< @return [V, channels]

  /// The last map becomes zero, as JointNet's starts: all displacements are zero then.
  void zero_last();

 private:
  GraphStack units_ = nullptr;
  DenseStack whole_ = nullptr, head_ = nullptr;
  torch::nn::Dropout dropout_ = nullptr;
  nn::Linear last_ = nullptr;
};
TORCH_MODULE(VertexNetwork);

}  // namespace anigen::models::rignet
