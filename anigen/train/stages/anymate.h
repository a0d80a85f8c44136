#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/anymate/dataset.h"
#include "anigen/anymate/model.h"
#include "anigen/core/config.h"
#include "anigen/train/stages/rig_stage.h"

namespace anigen::train {

/// Fills the encoder of an Anymate model with the weights that the released trainings begin from (reference
/// anymate-baselines.md, 2.2 and 2.3): for Point-BERT the `model.point_backbone.*` of PointLLM, for Michelangelo the
/// `model.shape_model.*` and `model.shape_projection` of "shapevae-256". Nothing else of the file is read. Where
/// Michelangelo's `input_proj` has 54 columns, those are filled and the 25 of the normal's harmonics stay as they are.
/// @param path the file, `.bin`, `.ckpt`, `.pt`, `.pth` or `.safetensors`, or a folder with the parts of a large model,
/// model*.safetensors or else pytorch_model*.bin
/// @throws InputError for a path without such weights, when one of the encoder's tensors is in none of them, and for
/// shapes; the model is then untouched. NotSupportedError for the scratch encoder, which has no pretrained weights
void load_pretrained_encoder(anymate::AnymateModelImpl& model, const std::filesystem::path& path);

/// Anymate's metrics of one of its models over samples. See AnymateStage for their names.
class AnymateScores {
 public:
  /// @param model in evaluation mode @param train_steps, joints of a denoiser
  AnymateScores(anymate::AnymateModelImpl& model, std::int64_t train_steps, std::int64_t joints, torch::Device device)
      : model_(model), train_steps_(train_steps), joints_(joints), device_(device) {}

  /// @param index names the random draws of this sample
  void add(const anymate::AnymateSample& sample, std::uint64_t index);
  const RigScores& scores() const { return scores_; }

 private:
  void add_joints(const anymate::AnymateSample& sample, const torch::Tensor& latents, std::uint64_t index);
  void add_connectivity(const anymate::AnymateBatch& batch, const torch::Tensor& latents);
  void add_skinning(const anymate::AnymateBatch& batch, const torch::Tensor& latents);

  anymate::AnymateModelImpl& model_;
  std::int64_t train_steps_, joints_;
  torch::Device device_;
  RigScores scores_;
};

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
  AnymateStage(const anymate::ModelOptions& model, const AnymateStageOptions& options, anymate::AnymateDatasets data,
               std::string model_name, torch::Device device);

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_.train; }
  Losses losses(const data::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;

 private:
  RigScores scores(std::size_t assets) override;

  AnymateStageOptions options_;
  anymate::AnymateDatasets data_;
  std::string model_name_;
  torch::Device device_;
  anymate::AnymateModel model_;
};

/// The stage of a config `{models, dataset, trainer}` whose trainer is AnymateTrainer: one model "AnymateModel" with
/// the arguments of anymate::ModelOptions, and the data set "Anymate".
/// @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_anymate_stage(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                          const TrainerOptions& trainer, torch::Device device);

}  // namespace anigen::train
