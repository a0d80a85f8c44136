#pragma once
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/structured_latent/options.h"
#include "anigen/structured_latent/rig_loss.h"
#include "anigen/train/stages/autoencoder_stage.h"
#include "anigen/vision/lpips.h"

namespace anigen::train {

/// The two models of the stage. They must fit each other.
struct StructuredLatentCoders {
  structured_latent::StructuredLatentEncoderOptions encoder;
  structured_latent::StructuredLatentDecoderOptions decoder;

  /// @throws InputError naming what does not fit
  void validate(const std::string& file) const;
};

/// Arguments of AniGenSLatVaeSkeletonTrainer beside those all trainers share (docs/reference/training.md, 3.3).
struct StructuredLatentAutoEncoderStageOptions {
  shape_field::GeometryLossOptions
      geometry;                           ///< `depth_loss_type`, `lambda_depth`, `_tsdf`, `_color`, `_ssim`, `_lpips`
  structured_latent::RigLossOptions rig;  ///< `lambda_joints`, `lambda_parents`, `lambda_skin_…`, `alpha_conf_…`
  double lambda_kl = 1e-3, lambda_kl_skl = 1e-3;  ///< of the posterior's divergence, where a latent gets no noise
  LatentDenoising noise;  ///< `latent_*`: of the skin latent, and of the geometry's where the variant is geometry_dae
  LatentDenoising noise_skl;  ///< `latent_*_skl`
  // Ours.
  /// Of an asset without a surface, which no picture can pull back: its tsdf_loss over the squared truncation.
  double lambda_lost_surface = 0.0;
  /// Only the decoder is trained, so that flows may be trained on the latents meanwhile. Needs weights to start from.
  bool frozen_encoder = false;
  structured_latent::StructuredLatentVariant variant;
  std::vector<std::filesystem::path>
      lpips_weights;                  ///< files of VGG16 and of the heads; needed while lambda_lpips counts
  std::filesystem::path skin_ae_run;  ///< run folder of stage 1 in place of pretrained_dir/<skin_ae_name>
  std::int64_t skin_vertices = 0;     ///< vertices per asset that the skin is compared at, drawn anew; 0: all
  std::int64_t memory_budget_mb = 0;  ///< of activations of a micro-batch; above it blocks are recomputed. 0: none
  std::int64_t eval_max_assets = 0;   ///< held-out assets, 0: all
  std::int64_t eval_surface_points = 8192;  ///< per surface, of the Chamfer distance
  std::int64_t sample_assets = 4;           ///< rows of a sheet
  WarmStartOptions warm_start;

  /// @param decoder as the config has it @param compatibility see docs/training.md @throws InputError
  static StructuredLatentAutoEncoderStageOptions read(ConfigReader& trainer_args,
                                                      const structured_latent::StructuredLatentDecoderOptions& decoder,
                                                      const std::string& compatibility);
};

/// Stage 3: structured latents of shape, skin and skeleton on sparse voxels, and their decoder into the S³ fields
/// (paper 3.3). Loss terms under their published names: "kl" and "kl_skl" where the latent gets no noise; "reg_loss" of
/// the mesh field; "geo_loss" with "tsdf_loss", "mask_loss", "depth_loss", "normal_loss", "normal_loss_ssim" and
/// "normal_loss_perceptual", "color_loss", and ours, "lost_surface_loss", only while something trainable lies behind
/// the geometry; "joints_loss", "parents_loss", "skin_feats_joints_var_loss", "skin_kl_loss",
/// "skin_feats_l2_loss_vert", "skin_feats_l2_loss_joints" unless the shape alone is trained. No "kl" with a frozen
/// encoder.
///
/// Evaluation on held-out assets, means over them, without noise: "surfaces", the share whose shape has a surface, and
/// over those "chamfer" to the true one; "joints_loss", "parents_loss", "skin_kl_loss" as above; "joint_count_error",
/// |grouped − true joints|, and "joint_chamfer" between them.
class StructuredLatentAutoEncoderStage
    : public AutoEncoderStage<structured_latent::StructuredLatentEncoder, structured_latent::StructuredLatentDecoder,
                              StructuredLatentCoders, StructuredLatentAutoEncoderStageOptions> {
 public:
  /// @param held_out may be null: evaluate() and sample() then do nothing @param lpips with weights; may be null
  StructuredLatentAutoEncoderStage(const StructuredLatentCoders& coders,
                                   const StructuredLatentAutoEncoderStageOptions& options, Dataset data,
                                   Dataset held_out, torch::Device device, vision::Lpips lpips = nullptr,
                                   nn::Init init = nn::Init::kPublished);

  Losses losses(const data::Batch& batch, const LossContext& context) override;
  void warm_start(const LoadedKeys& finetuned) override;
  Values evaluate() override;
  /// Writes reconstructions.png: for some held-out assets the true mesh with its skeleton, the decoded mesh with the
  /// grouped one, the true skin weights, and those decoded for the true joints.
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override {
    return with_frozen_weights(std::make_unique<StructuredLatentAutoEncoderStage>(coders_, options_, data_, held_out_,
                                                                                  device_, lpips_, nn::Init::kNone));
  }

  /// True when anything trainable lies behind the decoded shape.
  bool trains_geometry() const { return trains_geometry_; }

 private:
  /// A batch on the device.
  struct Inputs {
    sparse::SparseTensor x, x_skl;
    structured_latent::RiggedMeshes rigs;
    std::vector<skeleton_field::SkeletonTensors> skeletons;  ///< true ones, per asset
    std::vector<bool> is_bad_skin;
  };
  using Latents = structured_latent::StructuredLatentEncoderImpl::Output;
  using Fields = structured_latent::StructuredLatentDecoderImpl::Fields;
  using Meshes = std::vector<shape_field::ExtractedMesh>;

  /// One held-out asset and what the models make of it.
  struct Reconstruction {
    std::string id;
    Inputs inputs;
    Latents latents;
    Fields decoded;  ///< with the true skeleton
    Meshes meshes;   ///< one
    skeleton_field::SkeletonTensors grouped;
  };

  Inputs inputs_of(const data::FeatureSkeletonBatch& batch) const;
  Latents encode(const Inputs& inputs, at::Generator* generator);
  static structured_latent::PerStream<sparse::SparseTensor> streams_of(const Latents& latents);
  void silence_skin_encoder();
  void fit_memory(const data::FeatureSkeletonBatch& batch);
  void start_model(torch::nn::Module& model, bool pretrained, const char* class_name, const std::string& skin_name,
                   const std::string& skin_part, std::set<std::string> loaded);
  shape_field::PictureDistance picture_distance();
  /// @param chosen per asset, rows of the mesh's vertices that count; an undefined tensor: all
  structured_latent::RigLosses compare_rigs(const Inputs& inputs, const Latents& latents, const Fields& decoded,
                                            const Meshes& meshes, const std::vector<torch::Tensor>& chosen);
  Reconstruction reconstruct(std::size_t held_out);

  vision::Lpips lpips_;
  bool trains_geometry_ = false;
};

}  // namespace anigen::train
