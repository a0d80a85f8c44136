#pragma once
#include <memory>
#include <string>

#include "anigen/core/config.h"
#include "anigen/data/skin_dataset.h"
#include "anigen/skin_field/loss.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"

namespace anigen::train {

/// Arguments of AniGenSkinAETrainer beside those all trainers share (reference training-and-data.md, section 3.1).
struct SkinAutoEncoderStageOptions {
  skin_field::SkinLossOptions loss;    ///< `lambda_*_skin`; ours: `kl_reduction` "element" (published) or "row"
  std::int64_t num_skin_samples = 0;   ///< points per asset; absent or null: all vertices
  bool unit_gain = false;              ///< ours, `init`: "published", or "unit_gain" (skin_field/skin_autoencoder.h)
  data::Augmentations augmentations;   ///< ours
  std::int64_t eval_max_vertices = 0;  ///< ours: vertices per held-out asset, 0: all
  std::int64_t eval_max_assets = 0;    ///< ours: held-out assets, 0: all

  static SkinAutoEncoderStageOptions read(ConfigReader& trainer_args, const std::string& compatibility);
};

/// Stage 1: the skin auto-encoder learns to give back the skin weights it is shown (paper 3.3.1). Loss terms: "kl",
/// "l1", "l2". Evaluation on held-out assets: "l1", mean over assets and vertices of Σ_j |ŝ − s|, and "kl", of
/// Σ_j s (log s − log ŝ), in nats.
class SkinAutoEncoderStage : public Stage {
 public:
  using Datasets = std::shared_ptr<const data::SkinDataset>;

  /// @param held_out may be null: evaluate() then returns nothing
  SkinAutoEncoderStage(const skin_field::SkinAutoEncoderOptions& model, const SkinAutoEncoderStageOptions& options,
                       Datasets data, Datasets held_out, std::string model_name, torch::Device device);

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_; }
  Losses losses(const data::Batch& batch, const LossContext& context) override;
  bool supports(torch::Dtype dtype) const override { return dtype == torch::kFloat32 || dtype == torch::kFloat64; }
  void set_compute_dtype(torch::Dtype dtype) override;
  Values evaluate() override;
  std::unique_ptr<Stage> replica() const override;

 private:
  skin_field::SkeletonBatch skeletons_of(const std::vector<torch::Tensor>& joints,
                                         const std::vector<torch::Tensor>& parents) const;

  skin_field::SkinAutoEncoderOptions model_options_;
  SkinAutoEncoderStageOptions options_;
  Datasets data_, held_out_;
  std::string model_name_;
  torch::Device device_;
  torch::Dtype dtype_ = torch::kFloat32;
  skin_field::SkinAutoEncoder model_;
};

/// The stage of a config `{models, dataset, trainer}` whose trainer is AniGenSkinAETrainer.
/// @param trainer the options already read from the same config @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_skin_autoencoder_stage(const Json& config, const std::string& file,
                                                   ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                   torch::Device device);

}  // namespace anigen::train
