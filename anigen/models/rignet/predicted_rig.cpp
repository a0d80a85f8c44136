#include "anigen/models/rignet/predicted_rig.h"

#include "anigen/fields/tensor_points.h"
#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

Eigen::MatrixXd square_of(const Tensor& matrix) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Tensor rows = matrix.to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const Rows>(rows.data_ptr<double>(), rows.size(0), rows.size(1));
}

}  // namespace

JointClusters clusters_of(RignetModelImpl& model) {
  JointClusters options;
  options.bandwidth = model.network<JointNetworkImpl>().bandwidth().abs().item<double>();
  options.mirrored = model.options().mirrored;
  return options;
}

PredictedTree predicted_tree(RignetModelImpl& model, const ConnectivityInput& input, const Tensor& outside) {
  const torch::NoGradGuard no_grad;
  const std::int64_t joints = input.joints.positions.size(0);
  anymate::require_shape(outside, {joints, joints}, "outside");
  const auto chances = connectivity_chances(model.network<ConnectivityNetworkImpl>().forward(input), input);
  PredictedTree tree;
  tree.graph.joints = fields::points_of<double>(input.joints.positions, "joints");
  tree.graph.bone = square_of(chances.bone);
  tree.graph.root = square_of(chances.root.unsqueeze(1));
  tree.graph.outside = square_of(outside);
  tree.parents = skeleton_tree(tree.graph);
  return tree;
}

Tensor predicted_weights(RignetModelImpl& model, const MeshGraph& graph, const BoneSlots& slots, std::int64_t bones) {
  const torch::NoGradGuard no_grad;
  const Tensor shares = torch::softmax(model.network<SkinNetworkImpl>().forward(graph, slots), 1);
  return scattered_to_bones(shares, slots.bones, bones).to(torch::kCPU, torch::kFloat32);
}

}  // namespace anigen::models::rignet
