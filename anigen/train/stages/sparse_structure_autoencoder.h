#pragma once
#include <memory>
#include <string>

#include "anigen/core/config.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/flow_stage.h"
#include "anigen/train/warm_start.h"

namespace anigen::train {

/// Arguments of AniGenSparseStructureVaeTrainer beside those all trainers share (reference training-and-data.md, 3.2).
struct SparseStructureAutoEncoderStageOptions {
  sparse_structure::OccupancyLoss loss_type = sparse_structure::OccupancyLoss::kBce;
  double lambda_kl = 1e-3, lambda_kl_skl = 1e-3;  ///< of the posterior's divergence, where a latent gets no noise
  LatentDenoising noise, noise_skl;               ///< `latent_*` and `latent_*_skl`
  std::int64_t eval_max_assets = 0;               ///< ours: held-out assets, 0: all
  WarmStartOptions warm_start;                    ///< ours: `pretrained_dir`, `warm_start`

  static SparseStructureAutoEncoderStageOptions read(ConfigReader& trainer_args);
};

/// The two models of the stage. They must fit each other.
struct SparseStructureCoders {
  sparse_structure::SparseStructureEncoderOptions encoder;
  sparse_structure::SparseStructureDecoderOptions decoder;

  /// @throws InputError naming what does not fit
  void validate(const std::string& file) const;
  /// @param resolution edge of the occupancy grids
  /// @param dataset_args where that was read, for messages @throws InputError when these models cannot encode such
  /// grids
  void require_resolution(std::int64_t resolution, const ConfigReader& dataset_args) const;
};

/// Stage 2: dense latents of the occupancy of surface and skeleton (paper 3.2.2), models `encoder` and `decoder`. Loss
/// terms "dice" (or "bce", "l1"), "kl" where the stream's latent gets no noise, and both with `_skl`. Evaluation on
/// held-out assets, means over assets: "iou_shape", "f1_shape", "iou_skl", "f1_skl" of the voxels with a logit above 0,
/// F1 with a tolerance of one voxel (sparse_structure/voxel_metrics.h). Samples: reconstructions, and what lies between
/// two latents.
///
/// Cost: configs/tiny/ss_dae.json (widths 8, 16, 48 at 64³, one block a level) multiplies and adds 2.6 G times per
/// stream and sample in the encoder and 4.1 G in the decoder: 26 GFLOP forward for both streams, three times that in a
/// training step. The published widths take 323 G and 407 G per stream: 2.9 TFLOP forward.
class SparseStructureAutoEncoderStage : public Stage {
 public:
  using Dataset = std::shared_ptr<const data::BatchSource>;  ///< of SparseStructureBatch

  /// @param held_out may be null: evaluate() and sample() then do nothing
  SparseStructureAutoEncoderStage(const SparseStructureCoders& coders,
                                  const SparseStructureAutoEncoderStageOptions& options, Dataset data, Dataset held_out,
                                  torch::Device device, nn::Init init = nn::Init::kPublished);

  std::vector<nn::NamedModel> models() const override {
    return {{"encoder", encoder_.ptr()}, {"decoder", decoder_.ptr()}};
  }
  const data::BatchSource& data() const override { return *data_; }
  Losses losses(const data::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;
  bool supports(torch::Dtype dtype) const override {
    return dtype == torch::kHalf ? device_.is_cuda() : dtype != torch::kFloat64;
  }
  void set_compute_dtype(torch::Dtype dtype) override;
  Values evaluate() override;
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override;

  sparse_structure::SparseStructureEncoder& encoder() { return encoder_; }
  sparse_structure::SparseStructureDecoder& decoder() { return decoder_; }

 private:
  /// One held-out asset and what the models make of it.
  struct Reconstruction {
    std::string id;
    torch::Tensor shape, skeleton;                  // bool [R, R, R], ground truth
    torch::Tensor decoded_shape, decoded_skeleton;  // the same, decoded
    sparse_structure::SparseStructureEncoderImpl::Output latents;
  };
  Reconstruction reconstruct(std::size_t held_out);

  SparseStructureCoders coders_;
  SparseStructureAutoEncoderStageOptions options_;
  Dataset data_, held_out_;
  torch::Device device_;
  sparse_structure::SparseStructureEncoder encoder_;
  sparse_structure::SparseStructureDecoder decoder_;
};

/// The stage of a config `{models, dataset, trainer}` whose trainer is AniGenSparseStructureVaeTrainer.
/// @param trainer the options already read from the same config @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_sparse_structure_autoencoder_stage(const Json& config, const std::string& file,
                                                               ConfigReader& trainer_args,
                                                               const TrainerOptions& trainer, torch::Device device);

}  // namespace anigen::train
