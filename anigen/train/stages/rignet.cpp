#include "anigen/train/stages/rignet.h"

#include <algorithm>

#include "anigen/nn/init.h"
#include "anigen/rignet/dataset.h"
#include "anigen/rignet/model.h"
#include "anigen/rignet/skeleton.h"
#include "anigen/train/stages/rig_stage.h"

namespace anigen::train {

namespace {

using torch::Tensor;

Tensor without_padding(const anymate::AnymateBatch& batch) {
  const std::int64_t joints = batch.joints_num.front();
  return batch.conns[0].narrow(0, 0, joints).narrow(1, 0, joints);
}

// Bones by pairs and the root by itself, as rows of a joint's possible parents.
metrics::SkinMatrix rows_of_chances(const rignet::JointGraph& graph) {
  metrics::SkinMatrix rows = graph.bone;
  rows.diagonal() = graph.root;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) rows.row(i) /= std::max(rows.row(i).sum(), 1e-12);
  return rows;
}

rignet::MeshGraph joined_graph(const std::vector<rignet::RignetSample>& samples, torch::Device device) {
  std::vector<rignet::MeshGraph> graphs;
  for (const rignet::RignetSample& sample : samples) graphs.push_back(sample.graph);
  return rignet::joined(graphs).to(device);
}

class RignetStage final
    : public RigStage<rignet::RignetModel, rignet::RignetDatasets, rignet::RignetDraws, RignetStageOptions> {
 public:
  RignetStage(const rignet::RignetOptions& model, const RignetStageOptions& options, rignet::RignetDatasets data,
              std::string name, torch::Device device)
      : RigStage("RigNet", "rignet", model, options, std::move(data), std::move(name), device) {}

 private:
  Losses loss(const Samples& samples, std::int64_t step) override {
    switch (model_->options().task) {
      case rignet::Task::kConnectivity:
        return connectivity_terms(samples);
      case rignet::Task::kSkinning:
        return skin_terms(samples);
      default:
        return joint_terms(samples, step);
    }
  }

  Losses joint_terms(const Samples& samples, std::int64_t step) {
    auto& network = model_->network<rignet::JointNetworkImpl>();
    const rignet::MeshGraph graph = joined_graph(samples, device_);
    std::vector<Tensor> joints, attention;
    for (const rignet::RignetSample& sample : samples) {
      joints.push_back(sample.joints.to(device_));
      attention.push_back(sample.attention.to(device_));
    }
    const bool clusters = step >= options_.clustering_from;
    // L = L_chamfer + L_attention at first, then L_chamfer + 2 L_clusters + 0.1 L_attention.
    const rignet::JointLosses found = rignet::joint_losses(network.forward(graph), graph, joints, torch::cat(attention),
                                                           network.bandwidth(), clusters ? options_.mean_shifts : 0);
    Losses losses{found.chamfer + found.attention, {{"chamfer", found.chamfer}, {"attention", found.attention}}};
    if (!clusters) return losses;
    losses.total =
        found.chamfer + options_.clustering_weight * found.clusters + options_.attention_weight * found.attention;
    losses.terms.emplace_back("clusters", found.clusters);
    return losses;
  }

  Losses connectivity_terms(const Samples& samples) {
    std::vector<rignet::MeshGraph> graphs;
    std::vector<Tensor> joints, inside, parents;
    for (const rignet::RignetSample& sample : samples) {
      graphs.push_back(sample.graph);
      joints.push_back(sample.joints);
      inside.push_back(sample.inside);
      parents.push_back(sample.rig.conns);
    }
    const auto logits = model_->network<rignet::ConnectivityNetworkImpl>().forward(
        rignet::connectivity_input(graphs, joints, inside, device_));
    const rignet::ConnectivityTruth truth = rignet::connectivity_truth(parents, device_);
    const Tensor bone = rignet::hard_binary_loss(logits.bone, truth.bone);
    const Tensor root = rignet::hard_binary_loss(logits.root, truth.root);
    return {bone + root, {{"bone", bone}, {"root", root}}};
  }

  Losses skin_terms(const Samples& samples) {
    std::vector<Tensor> bones, features, weights;
    for (const rignet::RignetSample& sample : samples) {
      bones.push_back(sample.slots.bones);
      features.push_back(sample.slots.features);
      weights.push_back(sample.weights);
    }
    const rignet::BoneSlots slots = rignet::BoneSlots{torch::cat(bones), torch::cat(features)}.to(device_);
    const Tensor logits = model_->network<rignet::SkinNetworkImpl>().forward(joined_graph(samples, device_), slots);
    const Tensor loss = rignet::skin_slot_loss(logits, torch::cat(weights).to(device_));
    return {loss, {{"ce", loss}}};
  }

  void score(const rignet::RignetSample& sample, std::uint64_t, RigScores& scores) override {
    switch (model_->options().task) {
      case rignet::Task::kJoints:
        return add_joints(sample, scores);
      case rignet::Task::kConnectivity:
        return add_connectivity(sample, scores);
      case rignet::Task::kSkinning:
        return add_skinning(sample, scores);
    }
  }

  void add_joints(const rignet::RignetSample& sample, RigScores& scores) {
    const auto displaced = model_->network<rignet::JointNetworkImpl>().forward(sample.graph.to(device_));
    const Tensor joints = rignet::clustered_joints(displaced.points, torch::sigmoid(displaced.attention_logits),
                                                   sample.solid->holds(displaced.points), rignet::clusters_of(*model_));
    scores.add_joints(sample.rig.name, rignet::in_anymate_frame(joints, sample.frame),
                      nn::points_of<double>(sample.rig.joints, "joints"));
  }

  void add_connectivity(const rignet::RignetSample& sample, RigScores& scores) {
    const auto input = rignet::connectivity_input({sample.graph}, {sample.joints}, {sample.inside}, device_);
    const rignet::PredictedTree tree = rignet::predicted_tree(*model_, input, sample.outside);
    const auto batch = anymate::collate({sample.rig}, {sample.rig.joints.size(0), sample.rig.bones.size(0)});
    scores.add_connectivity(sample.rig.name, rows_of_chances(tree.graph), parent_rows(tree.parents),
                            matrix_of(without_padding(batch)), nn::points_of<double>(sample.rig.joints, "joints"));
  }

  void add_skinning(const rignet::RignetSample& sample, RigScores& scores) {
    const std::int64_t bones = sample.rig.bones.size(0);
    const Tensor at_vertices =
        rignet::predicted_weights(*model_, sample.graph.to(device_), sample.slots.to(device_), bones);
    const Tensor of_corners =
        at_vertices.index_select(0, sample.corners.flatten()).view({sample.corners.size(0), 3, bones});
    const Tensor predicted = (of_corners * sample.shares.unsqueeze(2)).sum(1);
    const auto batch = anymate::collate({sample.rig}, {sample.rig.joints.size(0), bones});
    scores.add_skinning(sample.rig.name, predicted, batch.skins[0].narrow(1, 0, bones),
                        sample.rig.points_cloud.narrow(1, 0, 3), sample.rig.bones);
  }
};

}  // namespace

void RignetStageOptions::fields(ConfigFields& f) {
  f("clustering_from", clustering_from, {0});
  f("mean_shifts", mean_shifts, {1, 1000});
  f("clustering_weight", clustering_weight, {0.0});
  f("attention_weight", attention_weight, {0.0});
  f("eval_max_assets", eval_max_assets, {0});
}

std::unique_ptr<Stage> make_rignet_stage(const StageRequest& request) {
  const auto options = RignetStageOptions::read(request.args);
  require_one_replica(request, "RigNet");
  ConfigReader top(request.config, request.file);
  const auto [name, model] = read_only_model<rignet::RignetOptions>(top, {"RignetModel"});
  auto data = read_dataset<rignet::RignetDatasetOptions>(top, "Rignet");
  data.conversion.task = model.task;
  data.conversion.bones = model.bones;
  return std::make_unique<RignetStage>(model, options, rignet::open_rignet(data), name, request.device);
}

}  // namespace anigen::train
