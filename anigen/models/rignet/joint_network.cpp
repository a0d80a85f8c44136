#include "anigen/models/rignet/joint_network.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/joint_regression.h"
#include "anigen/models/rignet/mean_shift.h"

namespace anigen::models::rignet {
namespace {

Tensor distance_to_joints(const Tensor& points, const Tensor& joints) {
  return anymate::joint_chamfer_loss(points.unsqueeze(0), joints.unsqueeze(0), {joints.size(0)});
}

}  // namespace

JointNetworkImpl::JointNetworkImpl(const RignetOptions& options) : first_bandwidth_(options.bandwidth) {
  displace_ = register_module("displace", VertexNetwork(options, 3));
  attend_ = register_module("attend", VertexNetwork(options, 1));
  bandwidth_ = register_parameter("bandwidth", torch::empty({}));
}

void JointNetworkImpl::start() {
  displace_->zero_last();
  torch::nn::init::constant_(bandwidth_, first_bandwidth_);
}

DisplacedVertices JointNetworkImpl::forward(const MeshGraph& graph) {
  return {graph.vertices + torch::tanh(displace_(graph)), attend_(graph).squeeze(1)};
}

JointLosses joint_losses(const DisplacedVertices& displaced, const MeshGraph& graph, const std::vector<Tensor>& joints,
                         const Tensor& attention, const Tensor& bandwidth, std::int64_t shifts) {
  anymate::require(static_cast<std::int64_t>(joints.size()) == graph.meshes(), "joints", "must be given per mesh");
  anymate::require_shape(attention, {graph.vertices.size(0)}, "attention");
  const Tensor starts = graph.starts.cpu();
  const auto start = starts.accessor<std::int64_t, 1>();
  std::vector<Tensor> before, after;
  for (std::size_t b = 0; b < joints.size(); ++b) {
    const auto mesh = static_cast<std::int64_t>(b);
    const std::int64_t first = start[mesh], count = start[mesh + 1] - first;
    Tensor points = displaced.points.narrow(0, first, count);
    before.push_back(distance_to_joints(points, joints[b]));
    const Tensor attends = torch::sigmoid(displaced.attention_logits.narrow(0, first, count));
    for (std::int64_t i = 0; i < shifts; ++i) {
      points = mean_shifted(points, attends, bandwidth);
      after.push_back(distance_to_joints(points, joints[b]));
    }
  }
  JointLosses losses;
  losses.chamfer = torch::stack(before).mean();
  losses.attention = torch::binary_cross_entropy_with_logits(displaced.attention_logits, attention);
  if (!after.empty()) losses.clusters = torch::stack(after).mean();
  return losses;
}

}  // namespace anigen::models::rignet
