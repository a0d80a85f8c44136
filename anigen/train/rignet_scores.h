#pragma once
#include "anigen/loaders/rignet/rignet_samples.h"
#include "anigen/models/rignet/model.h"
#include "anigen/train/rig_scores.h"

namespace anigen::train {

/// Anymate's metrics of one of RigNet's models over held-out samples, on the truth that Anymate's models are measured
/// on. Joints are read off as at inference. Parents are those of the published tree; the cross entropy is that of rows
/// of BoneNet's probabilities with RootNet's on the diagonal, divided by their sums. Weights are SkinNet's at vertices,
/// before they are cleaned (zeros would make any cross entropy), interpolated at Anymate's points of the surface.
class RignetScores {
 public:
  /// @param model in evaluation mode
  RignetScores(models::rignet::RignetModelImpl& model, torch::Device device) : model_(model), device_(device) {}

  /// @param sample converted for the model's task, as held out
  void add(const loaders::RignetSample& sample);
  const RigScores& scores() const { return scores_; }

 private:
  void add_joints(const loaders::RignetSample& sample);
  void add_connectivity(const loaders::RignetSample& sample);
  void add_skinning(const loaders::RignetSample& sample);

  models::rignet::RignetModelImpl& model_;
  torch::Device device_;
  RigScores scores_;
};

}  // namespace anigen::train
