#pragma once
#include <memory>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/rignet/graph.h"

namespace anigen::rignet {

/// Numbers for each vertex of a mesh, seen together with the whole: JointNet with three channels, MaskNet with one
/// (docs/reference/rignet.md, 3). Units of 64, 256 and 512, their outputs to one code of 1024 for the mesh, beside
/// which each vertex passes 1024 and 256 and, after dropout, a linear map without activation. Keys `units.*`,
/// `whole.*`, `head.*`, `last.*`.
class VertexNetworkImpl : public torch::nn::Module {
 public:
  VertexNetworkImpl(const RignetOptions& options, std::int64_t channels);
  Tensor forward(const MeshGraph& graph);  ///< @return [V, channels]

  /// The last map becomes zero, as JointNet's starts: all displacements are zero then.
  void zero_last() { nn::zero_parameters(*last_); }

 private:
  GraphStack units_ = nullptr;
  DenseStack whole_ = nullptr, head_ = nullptr;
  torch::nn::Dropout dropout_ = nullptr;
  nn::Linear last_ = nullptr;
};
TORCH_MODULE(VertexNetwork);

/// Displacements that gather the vertices of meshes at joints, with the weight of each.
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

/// A set abstraction of PointNet++ (Qi et al. 2017): around each centre the largest of MLP([x_j, p_j − p_i]). Keys
/// `mlp.*`.
class SetAbstractionImpl : public torch::nn::Module {
 public:
  /// @param widths of the MLP, the first being that of the features and 3 for the offsets
  SetAbstractionImpl(double ratio, double radius, const std::vector<std::int64_t>& widths);

  struct Result {
    PointSets centres;
    Tensor features;  ///< [centres, last width]
  };
  /// @param features [N, first width − 3], undefined where that is nothing @throws InputError for shapes
  Result forward(const PointSets& points, const Tensor& features);

 private:
  double ratio_, radius_;
  DenseStack mlp_ = nullptr;
};
TORCH_MODULE(SetAbstraction);

/// Features beside positions, for the MLP that codes whole sets. @param features [N, C] @return [N, C + 3]
Tensor with_positions(const Tensor& features, const PointSets& points);

/// Input of BoneNet and RootNet: meshes, their joints, and every pair of joints of one mesh. RigNet's frame.
struct ConnectivityInput {
  MeshGraph graph;
  PointSets joints;
  Tensor first, second;  ///< [P] int64 rows of joints, first < second
  Tensor inside;         ///< [P] the share of the segment between them that is inside the mesh
};

/// All pairs of each mesh. @param graphs one mesh each @param joints [J, 3], J ≥ 1 @param inside [J, J], symmetric
/// @throws InputError for shapes
ConnectivityInput connectivity_input(const std::vector<MeshGraph>& graphs, const std::vector<Tensor>& joints,
                                     const std::vector<Tensor>& inside, torch::Device device = torch::kCPU);

/// The truth for the same pairs and joints, 0 or 1.
struct ConnectivityTruth {
  Tensor bone;  ///< [P]
  Tensor root;  ///< [ΣJ]
};

/// @param parents [J] int64 of each mesh, its own index for a root, in the order of the input's meshes
ConnectivityTruth connectivity_truth(const std::vector<Tensor>& parents, torch::Device device = torch::kCPU);

/// RootNet: which joint is the root, from the shape's code and from each joint among the others, beginning with its
/// |x| (docs/reference/rignet.md, 4). The description gives no widths of the way back from the code of all joints to
/// each: they are 256, 128 and 128 here, and the way up is BoneNet's without its last two layers. Keys `shape.*`,
/// `near.*`, `far.*`, `all.*`, `back_far.*`, `back_near.*`, `back_joints.*`, `head.*`, `last.*`.
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

/// BoneNet: whether there is a bone between two joints, from codes of the shape, of all joints and of the pair: both
/// positions, their distance, the share of the way inside (docs/reference/rignet.md, 4). While training each pair is
/// looked at in an order drawn from LibTorch's generator; afterwards (ours) in both, and logits are their mean, so that
/// the answer does not depend on how joints are numbered. Keys `shape.*`, `near.*`, `far.*`, `joints.*`, `pair.*`,
/// `head.*`, `last.*`.
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

/// BCE, its mean over all and its mean over the hardest 30 %, added (docs/reference/rignet.md, 4).
/// @param logits, truth [N], at least one @return scalar
Tensor hard_binary_loss(const Tensor& logits, const Tensor& truth);

/// Probabilities of one mesh.
struct ConnectivityChances {
  Tensor bone;  ///< [J, J] fp32, symmetric, zero on the diagonal
  Tensor root;  ///< [J] fp32
};
/// @param input of one mesh @return on the CPU, without gradient
ConnectivityChances connectivity_chances(const ConnectivityLogits& logits, const ConnectivityInput& input);

inline constexpr std::int64_t kBoneNumbers = 8;  ///< head, tail, 1/D, whether it is a tip

/// The bones nearest to each vertex, which are those that RigNet weighs there. Nearest first.
struct BoneSlots {
  Tensor bones;     ///< [V, S] int64; -1 where there are fewer bones
  Tensor features;  ///< [V, S · kBoneNumbers] fp32, zero where there is none

  BoneSlots to(torch::Device device) const { return {bones.to(device), features.to(device)}; }
};

/// SkinNet (docs/reference/rignet.md, 5): vertices beside the numbers of their nearest bones through 128 and 64, a unit
/// of 512, a code of 1024 for the mesh, two units of 256, and both together through 1024 and 512 to a logit per slot.
/// Keys `input.*`, `first.*`, `whole.*`, `second.*`, `third.*`, `head.*`, `last.*`.
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

/// Smoothing of predicted weights in RigNet: each row becomes the mean of its neighbours' along mesh edges, without its
/// own; entries below `least` of the row's largest go; rows are divided by their sums. A vertex without neighbours
/// keeps its row. @param weights [V, K] @param ring of MeshGraph, each vertex being among its own sources
/// @return [V, K] @throws InputError for shapes
Tensor cleaned_weights(const Tensor& weights, const EdgeSet& ring, double least);

/// One of RigNet's models (Xu et al. 2020), written from the description in docs/reference/rignet.md, 3. All keys begin
/// with the word of its task: `joints.*`, `connectivity.*`, `skin.*`. Published checkpoints have others.
class RignetModelImpl : public torch::nn::Module {
 public:
  /// @param init kPublished: linear maps as PyTorch begins, the last one of JointNet at zero
  explicit RignetModelImpl(const RignetOptions& options, nn::Init init = nn::Init::kPublished);

  /// The network as its class: JointNetworkImpl, ConnectivityNetworkImpl or SkinNetworkImpl.
  /// @throws InputError when it is of another task
  template <typename Network>
  Network& network() {
    auto* found = dynamic_cast<Network*>(network_.get());
    if (found == nullptr) throw InputError("", "task", "'" + name_of(options_.task) + "' is another task");
    return *found;
  }

  const RignetOptions& options() const { return options_; }

 private:
  RignetOptions options_;
  std::shared_ptr<torch::nn::Module> network_;
};
TORCH_MODULE(RignetModel);

}  // namespace anigen::rignet
