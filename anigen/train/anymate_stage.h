#pragma once
#include <memory>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/anymate/anymate_dataset.h"
#include "anigen/models/anymate/model.h"
#include "anigen/train/anymate_scores.h"
#include "anigen/train/rig_stage.h"

namespace anigen::train {

/// Arguments of AnymateTrainer beside those all trainers share; released values are the defaults (reference
/// anymate-baselines.md, 3 to 5 and 8).
struct AnymateStageOptions {
  std::int64_t num_train_step = 100;       ///< levels of noise of a denoiser
  std::int64_t num_training_points = 128;  ///< joints that it denoises
  std::int64_t skin_points = 1024;         ///< of the sampled points, in a step of skinning
  std::int64_t field_cells = 50000;        ///< of the cells inside, in a step of a field
  std::int64_t eval_max_assets = 0;        ///< held-out assets to look at; 0: all
  std::string pretrained_encoder;          ///< ours: load_pretrained_encoder()'s path; empty: from random weights

  static AnymateStageOptions read(ConfigReader& trainer_args);
};

/// One of Anymate's models learns its task: joints, connectivity of given joints, or weights of given bones. The
/// decoder says which. Loss terms: "chamfer"; "mse"; "bce"; "ce"; "cos_clamp" with "ce".
/// Evaluation on held-out assets, Anymate's metrics in its frame (reference, 6): joints "cd", "emd", "precision",
/// "recall", "joints" (their mean number) and "skipped" (the share with fewer than two joints, in no mean);
/// connectivity "ce", "precision", "recall", and with "tree_" those of the shortest tree through the joints; skinning
/// "ce", "cos" (the cosine), "mae", "l1", "precision", "recall", and with "nearest_" those of the nearest bone.
class AnymateStage : public RigStage {
 public:
  AnymateStage(const models::anymate::ModelOptions& model, const AnymateStageOptions& options,
               loaders::AnymateDatasets data, std::string model_name, torch::Device device);

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const loaders::BatchSource& data() const override { return *data_.train; }
  Losses losses(const loaders::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;

 private:
  RigScores scores(std::size_t assets) override;

  AnymateStageOptions options_;
  loaders::AnymateDatasets data_;
  std::string model_name_;
  torch::Device device_;
  models::anymate::AnymateModel model_;
};

/// The stage of a config `{models, dataset, trainer}` whose trainer is AnymateTrainer: one model "AnymateModel" with
/// the arguments of models::anymate::ModelOptions, and the data set "Anymate".
/// @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_anymate_stage(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                          const TrainerOptions& trainer, torch::Device device);

}  // namespace anigen::train
