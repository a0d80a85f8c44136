#include "anigen/train/stages/rignet.h"

#include <algorithm>
#include <utility>

#include "anigen/core/log.h"
#include "anigen/nn/init.h"
#include "anigen/rignet/skeleton.h"
#include "anigen/train/stage.h"

namespace anigen::train {

namespace {

torch::Tensor without_padding(const anymate::AnymateBatch& batch) {
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

}  // namespace

void RignetScores::add(const rignet::RignetSample& sample) {
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

void RignetScores::add_joints(const rignet::RignetSample& sample) {
  const auto displaced = model_.network<rignet::JointNetworkImpl>().forward(sample.graph.to(device_));
  const torch::Tensor joints =
      rignet::clustered_joints(displaced.points, torch::sigmoid(displaced.attention_logits),
                               sample.solid->holds(displaced.points), rignet::clusters_of(model_));
  scores_.add_joints(sample.rig.name, rignet::in_anymate_frame(joints, sample.frame),
                     nn::points_of<double>(sample.rig.joints, "joints"));
}

void RignetScores::add_connectivity(const rignet::RignetSample& sample) {
  const auto input = rignet::connectivity_input({sample.graph}, {sample.joints}, {sample.inside}, device_);
  const rignet::PredictedTree tree = rignet::predicted_tree(model_, input, sample.outside);
  const auto batch = anymate::collate({sample.rig}, {sample.rig.joints.size(0), sample.rig.bones.size(0)});
  scores_.add_connectivity(sample.rig.name, rows_of_chances(tree.graph), parent_rows(tree.parents),
                           matrix_of(without_padding(batch)), nn::points_of<double>(sample.rig.joints, "joints"));
}

void RignetScores::add_skinning(const rignet::RignetSample& sample) {
  const std::int64_t bones = sample.rig.bones.size(0);
  const torch::Tensor at_vertices =
      rignet::predicted_weights(model_, sample.graph.to(device_), sample.slots.to(device_), bones);
  const torch::Tensor of_corners =
      at_vertices.index_select(0, sample.corners.flatten()).view({sample.corners.size(0), 3, bones});
  const torch::Tensor predicted = (of_corners * sample.shares.unsqueeze(2)).sum(1);
  const auto batch = anymate::collate({sample.rig}, {sample.rig.joints.size(0), bones});
  scores_.add_skinning(sample.rig.name, predicted, batch.skins[0].narrow(1, 0, bones),
                       sample.rig.points_cloud.narrow(1, 0, 3), sample.rig.bones);
}

namespace {

using torch::Tensor;

rignet::MeshGraph joined_graph(const std::vector<rignet::RignetSample>& samples, torch::Device device) {
  std::vector<rignet::MeshGraph> graphs;
  for (const rignet::RignetSample& sample : samples) graphs.push_back(sample.graph);
  return rignet::joined(graphs).to(device);
}

}  // namespace

RignetStageOptions RignetStageOptions::read(ConfigReader& args) {
  RignetStageOptions options;
  options.clustering_from = args.integer("clustering_from", 0, 0);
  options.mean_shifts = args.integer("mean_shifts", options.mean_shifts, 1, 1000);
  options.clustering_weight = args.number("clustering_weight", options.clustering_weight, 0.0);
  options.attention_weight = args.number("attention_weight", options.attention_weight, 0.0);
  options.eval_max_assets = args.integer("eval_max_assets", 0, 0);
  return options;
}

RignetStage::RignetStage(const rignet::RignetOptions& model, const RignetStageOptions& options,
                         rignet::RignetDatasets data, std::string model_name, torch::Device device)
    : RigStage("RigNet", data.held_out ? data.held_out->samples() : 0, options.eval_max_assets),
      options_(options),
      data_(std::move(data)),
      model_name_(std::move(model_name)),
      device_(device),
      model_(model) {
  model_->to(device_);
}

Losses RignetStage::losses(const data::Batch& batch, const LossContext& context) {
  torch::manual_seed(loss_generator(context, "rignet").current_seed());
  const auto& samples = dynamic_cast<const rignet::RignetDraws&>(batch).samples;
  switch (model_->options().task) {
    case rignet::Task::kConnectivity:
      return connectivity_terms(samples);
    case rignet::Task::kSkinning:
      return skin_terms(samples);
    default:
      return joint_terms(samples, context.step);
  }
}

Losses RignetStage::joint_terms(const Samples& samples, std::int64_t step) {
  auto& network = model_->network<rignet::JointNetworkImpl>();
  const rignet::MeshGraph graph = joined_graph(samples, device_);
  std::vector<Tensor> joints, attention;
  for (const rignet::RignetSample& sample : samples) {
    joints.push_back(sample.joints.to(device_));
    attention.push_back(sample.attention.to(device_));
  }
  const bool clusters = step >= options_.clustering_from;
  const rignet::JointLosses found = rignet::joint_losses(network.forward(graph), graph, joints, torch::cat(attention),
                                                         network.bandwidth(), clusters ? options_.mean_shifts : 0);
  Losses losses{found.chamfer + found.attention, {{"chamfer", found.chamfer}, {"attention", found.attention}}};
  if (!clusters) return losses;
  losses.total =
      found.chamfer + options_.clustering_weight * found.clusters + options_.attention_weight * found.attention;
  losses.terms.emplace_back("clusters", found.clusters);
  return losses;
}

Losses RignetStage::connectivity_terms(const Samples& samples) {
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

Losses RignetStage::skin_terms(const Samples& samples) {
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

RigScores RignetStage::scores(std::size_t assets) {
  model_->eval();
  RignetScores scores(*model_, device_);
  for (std::size_t i = 0; i < assets; ++i) scores.add(data_.held_out->sample(i));
  model_->train();
  return scores.scores();
}

std::unique_ptr<Stage> make_rignet_stage(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                         const TrainerOptions& trainer, torch::Device device) {
  const auto options = RignetStageOptions::read(trainer_args);
  require_one_replica(trainer, file, "RigNet");
  ConfigReader top(config, file);
  const OnlyModel model = read_only_model(top, "RignetModel");
  const auto model_options = rignet::RignetOptions::from_json(*model.args, file, model.pointer);

  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {"Rignet"});
  ConfigReader dataset_args = dataset.object("args");
  auto data_options = rignet::RignetDatasetOptions::read(dataset_args);
  dataset_args.finish();
  dataset.finish();
  data_options.conversion.task = model_options.task;
  data_options.conversion.bones = model_options.bones;

  const rignet::RignetDatasets data = rignet::open_rignet(data_options);
  log::info("{} meshes to train on, {} held out", data.train->samples(), data.held_out ? data.held_out->samples() : 0);
  return std::make_unique<RignetStage>(model_options, options, data, model.name, device);
}

}  // namespace anigen::train
