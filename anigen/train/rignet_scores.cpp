#include "anigen/train/rignet_scores.h"

#include <algorithm>

#include "anigen/fields/tensor_points.h"
#include "anigen/models/rignet/predicted_rig.h"

namespace anigen::train {
namespace {

namespace rignet = models::rignet;

torch::Tensor without_padding(const models::anymate::AnymateBatch& batch) {
  const std::int64_t joints = batch.joints_num.front();
  return batch.conns[0].narrow(0, 0, joints).narrow(1, 0, joints);
}

// Bones by pairs and the root by itself, as rows of a joint's possible parents.
eval::SkinMatrix rows_of_chances(const rignet::JointGraph& graph) {
  eval::SkinMatrix rows = graph.bone;
  rows.diagonal() = graph.root;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) rows.row(i) /= std::max(rows.row(i).sum(), 1e-12);
  return rows;
}

}  // namespace

void RignetScores::add(const loaders::RignetSample& sample) {
  const torch::NoGradGuard no_grad;
  switch (model_.options().task) {
    case rignet::Task::kJoints:
      return add_joints(sample);
    case rignet::Task::kConnectivity:
      return add_connectivity(sample);
    case rignet::Task::kSkinning:
      return add_skinning(sample);
  }
}

void RignetScores::add_joints(const loaders::RignetSample& sample) {
  const auto displaced = model_.network<rignet::JointNetworkImpl>().forward(sample.graph.to(device_));
  const torch::Tensor joints =
      rignet::clustered_joints(displaced.points, torch::sigmoid(displaced.attention_logits),
                               sample.solid->holds(displaced.points), rignet::clusters_of(model_));
  scores_.add_joints(sample.rig.name, loaders::in_anymate_frame(joints, sample.frame),
                     fields::points_of<double>(sample.rig.joints, "joints"));
}

void RignetScores::add_connectivity(const loaders::RignetSample& sample) {
  const auto input = rignet::connectivity_input({sample.graph}, {sample.joints}, {sample.inside}, device_);
  const rignet::PredictedTree tree = rignet::predicted_tree(model_, input, sample.outside);
  const auto batch = models::anymate::collate({sample.rig}, {sample.rig.joints.size(0), sample.rig.bones.size(0)});
  scores_.add_connectivity(sample.rig.name, rows_of_chances(tree.graph), parent_rows(tree.parents),
                           matrix_of(without_padding(batch)), fields::points_of<double>(sample.rig.joints, "joints"));
}

void RignetScores::add_skinning(const loaders::RignetSample& sample) {
  const std::int64_t bones = sample.rig.bones.size(0);
  const torch::Tensor at_vertices =
      rignet::predicted_weights(model_, sample.graph.to(device_), sample.slots.to(device_), bones);
  const torch::Tensor of_corners =
      at_vertices.index_select(0, sample.corners.flatten()).view({sample.corners.size(0), 3, bones});
  const torch::Tensor predicted = (of_corners * sample.shares.unsqueeze(2)).sum(1);
  const auto batch = models::anymate::collate({sample.rig}, {sample.rig.joints.size(0), bones});
  scores_.add_skinning(sample.rig.name, predicted, batch.skins[0].narrow(1, 0, bones),
                       sample.rig.points_cloud.narrow(1, 0, 3), sample.rig.bones);
}

}  // namespace anigen::train
