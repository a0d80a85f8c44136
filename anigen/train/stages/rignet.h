#pragma once
#include <memory>
#include <string>

#include "anigen/core/config.h"
#include "anigen/rignet/dataset.h"
#include "anigen/rignet/model.h"
#include "anigen/train/stages/rig_stage.h"

namespace anigen::train {

/// Anymate's metrics of one of RigNet's models over held-out samples, on the truth that Anymate's models are measured
/// on. Joints are read off as at inference. Parents are those of the published tree; the cross entropy is that of rows
/// of BoneNet's probabilities with RootNet's on the diagonal, divided by their sums. Weights are SkinNet's at vertices,
/// before they are cleaned (zeros would make any cross entropy), interpolated at Anymate's points of the surface.
class RignetScores {
 public:
  /// @param model in evaluation mode
  RignetScores(rignet::RignetModelImpl& model, torch::Device device) : model_(model), device_(device) {}

  /// @param sample converted for the model's task, as held out
  void add(const rignet::RignetSample& sample);
  const RigScores& scores() const { return scores_; }

 private:
  void add_joints(const rignet::RignetSample& sample);
  void add_connectivity(const rignet::RignetSample& sample);
  void add_skinning(const rignet::RignetSample& sample);

  rignet::RignetModelImpl& model_;
  torch::Device device_;
  RigScores scores_;
};

/// Arguments of RignetTrainer beside those all trainers share (reference anymate-baselines.md, 9.3).
struct RignetStageOptions {
  /// Of joints: the step from which mean shift is part of the loss. Before it JointNet and MaskNet learn apart, as in
  /// the published pre-training, each its own term; from it on the loss is chamfer + 2 clusters + 0.1 attention.
  std::int64_t clustering_from = 0;
  std::int64_t mean_shifts = 15;
  double clustering_weight = 2.0, attention_weight = 0.1;  ///< then
  std::int64_t eval_max_assets = 0;                        ///< held-out assets to look at; 0: all

  static RignetStageOptions read(ConfigReader& trainer_args);
};

/// One of RigNet's models learns its task. Loss terms: joints "chamfer", "attention", "clusters"; connectivity "bone",
/// "root"; skinning "ce". Evaluation on held-out assets: those of AnymateStage for the same task, by RigScores.
class RignetStage : public RigStage {
 public:
  RignetStage(const rignet::RignetOptions& model, const RignetStageOptions& options, rignet::RignetDatasets data,
              std::string model_name, torch::Device device);

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_.train; }
  Losses losses(const data::Batch& batch, const LossContext& context) override;

 private:
  using Samples = std::vector<rignet::RignetSample>;
  Losses joint_terms(const Samples& samples, std::int64_t step);
  Losses connectivity_terms(const Samples& samples);
  Losses skin_terms(const Samples& samples);
  RigScores scores(std::size_t assets) override;

  RignetStageOptions options_;
  rignet::RignetDatasets data_;
  std::string model_name_;
  torch::Device device_;
  rignet::RignetModel model_;
};

/// The stage of a config `{models, dataset, trainer}` whose trainer is RignetTrainer: one model "RignetModel" with the
/// arguments of rignet::RignetOptions, and the data set "Rignet". @throws InputError naming file and JSON
/// pointer
std::unique_ptr<Stage> make_rignet_stage(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                         const TrainerOptions& trainer, torch::Device device);

}  // namespace anigen::train
