#pragma once
#include <memory>
#include <string>

#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/train/stages/autoencoder_stage.h"

namespace anigen::train {

/// Arguments of AniGenSparseStructureVaeTrainer beside those all trainers share (docs/reference/training.md, 3.2).
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
  /// @param dataset_args where that was read, for messages @throws InputError when the models cannot encode these
  void require_resolution(std::int64_t resolution, const ConfigReader& dataset_args) const;
};

/// Stage 2: dense latents of the occupancy of surface and skeleton (paper 3.2.2), models `encoder` and `decoder`. Loss
/// terms "dice" (or "bce", "l1"), "kl" where the stream's latent gets no noise, and both with `_skl`. Evaluation on
/// held-out assets, means over assets: "iou_shape", "f1_shape", "iou_skl", "f1_skl" of the voxels with a logit above 0,
/// F1 with a tolerance of one voxel (sparse_structure/voxel_metrics.h). Samples: reconstructions, interpolations.
///
/// Cost: configs/tiny/ss_dae.json (widths 8, 16, 48 at 64³, one block a level) multiplies and adds 2.6 G times per
/// stream and sample in the encoder and 4.1 G in the decoder: 26 GFLOP forward for both streams, three times that in a
/// training step. The published widths take 323 G and 407 G per stream: 2.9 TFLOP forward.
class SparseStructureAutoEncoderStage
    : public AutoEncoderStage<sparse_structure::SparseStructureEncoder, sparse_structure::SparseStructureDecoder,
                              SparseStructureCoders, SparseStructureAutoEncoderStageOptions> {
 public:
  using AutoEncoderStage::AutoEncoderStage;

  Losses losses(const data::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;
  Values evaluate() override;
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override {
    return with_frozen_weights(std::make_unique<SparseStructureAutoEncoderStage>(coders_, options_, data_, held_out_,
                                                                                 device_, nn::Init::kNone));
  }

 private:
  /// One held-out asset and what the models make of it.
  struct Reconstruction {
    std::string id;
    sparse_structure::VoxelPair truth, decoded;
    sparse_structure::SparseStructureEncoderImpl::Output latents;
  };
  Reconstruction reconstruct(std::size_t held_out);
};

}  // namespace anigen::train
