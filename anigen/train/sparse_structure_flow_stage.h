#pragma once
#include <memory>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/flow/euler_sampler.h"
#include "anigen/flow/time_schedule.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "anigen/models/sparse_structure_decoder.h"
#include "anigen/models/sparse_structure_flow.h"
#include "anigen/train/condition_encoder.h"
#include "anigen/train/stage.h"
#include "anigen/train/trainer_options.h"
#include "anigen/train/warm_start.h"

namespace anigen::train {

/// Arguments of the trainers of stage 4 beside those all trainers share (reference training-and-data.md, 3.4).
struct SparseStructureFlowStageOptions {
  double p_uncond = 0.1;          ///< share of items whose condition becomes that of no picture
  flow::TimeSchedule t_schedule;  ///< published: logit-normal, mean 1
  double sigma_min = flow::kSigmaMin;
  // Ours.
  /// Of sample(): `sampler`, default that of the published pipeline, 25 steps with strength 7.5; with our sigma_min.
  flow::SamplerOptions sampler;
  std::int64_t sample_assets = 4;    ///< rows of a sheet of samples
  std::int64_t eval_max_assets = 0;  ///< held-out assets, 0: all
  std::int64_t eval_times = 4;       ///< flow times per held-out asset
  std::uint64_t seed = 0;            ///< of evaluation and samples: the trainer's

  /// `image_encoder` is read by make_condition_encoder(). @throws InputError
  static SparseStructureFlowStageOptions read(ConfigReader& trainer_args);
};

/// Stage 4: the sparse-structure flow learns the velocity from noise to the latents of stage 2 (paper 3.3.3). One time
/// per item, shared by both streams, independent noise; L = mse + mse_skl. Terms: "mse", "mse_skl", and both for every
/// tenth of the time axis that a micro-batch has items in, "bin_0.mse" … "bin_9.mse_skl".
///
/// Evaluation on held-out assets: "mse" and "mse_skl" at the times (k + ½) / eval_times with fixed noise and condition
/// views, the mean over assets and times. The same draws at every evaluation, so that its numbers can be compared.
class SparseStructureFlowStage : public Stage {
 public:
  using Dataset = std::shared_ptr<const loaders::StructureLatentDataset>;

  /// What a stage works with. Replicas share the datasets and the decoder.
  struct Parts {
    std::string name = "denoiser";  ///< of the model, in the config and in checkpoints
    models::SparseStructureFlow model = nullptr;
    std::unique_ptr<ConditionEncoder> encoder;         ///< null: not conditioned, the flow sees one token of zeros
    Dataset data, held_out;                            ///< held_out may be null
    models::SparseStructureDecoder decoder = nullptr;  ///< of stage 2, for sample(); null: no samples
    torch::Device device = torch::kCPU;
    WarmStartOptions start;
  };
  SparseStructureFlowStage(const SparseStructureFlowStageOptions& options, Parts parts);

  std::vector<NamedModel> models() const override;
  const loaders::BatchSource& data() const override { return *parts_.data; }
  Losses losses(const loaders::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;
  bool supports(torch::Dtype dtype) const override { return dtype != torch::kHalf || parts_.device.is_cuda(); }
  void set_compute_dtype(torch::Dtype dtype) override { parts_.model->set_compute_dtype(dtype); }
  Values evaluate() override;
  /// Writes samples.png: for some held-out assets (or training assets, where none is held out) the condition picture, a
  /// sample with and one without guidance, and the asset's own latents decoded. From fixed noise.
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override;

 private:
  // Squared error of each item of a batch, [B] per stream.
  struct ItemErrors {
    torch::Tensor shape, skeleton;
  };
  ItemErrors errors(const loaders::StructureLatentBatch& latents, const torch::Tensor& t, const torch::Tensor& noise,
                    const torch::Tensor& noise_skl, const torch::Tensor& condition);
  torch::Tensor condition_of(const loaders::StructureLatentBatch& latents);  // [B, M, C]
  flow::Streams drawn_sample(const flow::Streams& noise, const torch::Tensor& condition, bool guided);

  SparseStructureFlowStageOptions options_;
  Parts parts_;
};

/// The stage of a config whose trainer is AniGenImageConditionedFlowMatchingCFGTrainer, or AniGenFlowMatchingTrainer or
/// AniGenFlowMatchingCFGTrainer, which learn the same without pictures.
/// @param trainer the options already read from the same config @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_sparse_structure_flow_stage(const Json& config, const std::string& file,
                                                        ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                        torch::Device device);

}  // namespace anigen::train
