#pragma once
#include <vector>

#include "anigen/models/rignet/vertex_network.h"

namespace anigen::models::rignet {

/// Where the vertices of meshes go, so that they gather at joints, and how much each counts.
struct DisplacedVertices {
  Tensor points;            ///< [V, 3]: vertices, each moved by at most 1 along an axis
  Tensor attention_logits;  ///< [V]
};

/// RigNet's prediction of joints before they are read off: JointNet displaces vertices, MaskNet says which are near
/// joints, and the bandwidth of the clustering is learned with them. Keys `displace.*`, `attend.*`, `bandwidth`.
class JointNetworkImpl : public torch::nn::Module {
 public:
  explicit JointNetworkImpl(const RignetOptions& options);
  DisplacedVertices forward(const MeshGraph& graph);

  const Tensor& bandwidth() const { return bandwidth_; }  ///< scalar
  void start();  ///< initial values that are this module's own: no displacement, the bandwidth of the options

 private:
  double first_bandwidth_;
  VertexNetwork displace_ = nullptr, attend_ = nullptr;
  Tensor bandwidth_;
};
TORCH_MODULE(JointNetwork);

/// Losses of the published training, means over the meshes of a batch. Distances are Chamfer's as everywhere here: half
/// of each direction's mean, not squared (the reference leaves the form open).
struct JointLosses {
  Tensor chamfer;    ///< displaced vertices to joints
  Tensor attention;  ///< BCE of MaskNet
  Tensor clusters;   ///< mean over the steps of mean shift of the same distance after each; undefined without steps
};

/// @param joints [J, 3] of each mesh, J ≥ 1 @param attention [V] 0 or 1 @param shifts steps of mean shift, published 15
/// @throws InputError for shapes
JointLosses joint_losses(const DisplacedVertices& displaced, const MeshGraph& graph, const std::vector<Tensor>& joints,
                         const Tensor& attention, const Tensor& bandwidth, std::int64_t shifts);

}  // namespace anigen::models::rignet
