#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/voting.h"
#include "anigen/skin_field/skin_autoencoder.h"

namespace anigen::structured_latent {

/// Arguments that AniGenElasticSLatEncoder and AniGenElasticSLatMeshDecoder share (docs/reference/autoencoders.md, 4).
/// Both hold three transformers over sparse voxels: geometry (no suffix) and skin (`_skin`) on the surface voxels,
/// skeleton (`_skl`) on the skeleton voxels. Defaults are those of the class, not of its config; where the two classes
/// differ the derived one sets them.
struct StructuredLatentCoderOptions {
  std::int64_t resolution = 0;  ///< R of the voxels; required, like the widths and num_blocks
  std::int64_t model_channels = 0, model_channels_skl = 0, model_channels_skin = 0;         ///< torso widths
  std::int64_t latent_channels = 0, latent_channels_skl = 0, latent_channels_vertskin = 0;  ///< L, Lk, Ls
  std::int64_t num_blocks = 0;
  std::int64_t num_heads = 0;  ///< of the geometry; 0 (null in JSON): model_channels / num_head_channels
  std::int64_t num_head_channels = 64;
  std::int64_t num_heads_skl = 32, num_heads_skin = 32;
  double mlp_ratio = 4.0;
  std::string attn_mode = "swin";        ///< of the geometry: "swin" (shifted windows) or "full"
  std::string attn_mode_cross = "full";  ///< of all attention of the skin and the skeleton
  std::int64_t window_size = 8;
  bool use_fp16 = false;
  bool use_checkpoint = false;  ///< blocks are run again in the backward pass instead of being kept
  bool qk_rms_norm = false;     ///< of all self attention
  bool skin_cross_from_geo = false, skl_cross_from_geo = false;  ///< the stream attends to the geometry
  bool skin_skl_cross = false;                                   ///< skin and skeleton attend to each other
  bool use_pretrain_branch = true;     ///< training starts from files of weights named after the class and the SkinAE
  bool freeze_pretrain_branch = true;  ///< with use_pretrain_branch: modules_to_freeze are not trained
  std::vector<std::string> modules_to_freeze;
  std::string skin_ae_name = "SkinAE";  ///< name of the SkinAE's file of weights
  bool normalize_z = false;             ///< encoder: latents of L2 norm normalize_scale; decoder: of norm 1
  double normalize_scale = 1.0;         ///< above 0
  bool jp_residual_fields = true;       ///< joints and parents relative to the voxel
  bool jp_hyper_continuous = true;      ///< with a confidence that is 0 where the nearest joint changes

  std::int64_t heads() const { return num_heads > 0 ? num_heads : model_channels / num_head_channels; }
  bool freezes() const { return use_pretrain_branch && freeze_pretrain_branch; }

 protected:
  void fields(ConfigFields& f);
  void validate_coder(const OptionCheck& check) const;
};

/// Arguments of AniGenElasticSLatEncoder.
struct StructuredLatentEncoderOptions : StructuredLatentCoderOptions, JsonOptions<StructuredLatentEncoderOptions> {
  StructuredLatentEncoderOptions();
  std::int64_t in_channels = 0;          ///< of the image features; required
  std::int64_t skl_pos_embed_freq = 10;  ///< bands of the embedding of joints and parents
  skin_field::SkinEncoderOptions skin_encoder_config;
  bool encode_upsampled_skin_feat = true;  ///< skin features at eight places of a voxel; false: at its centre
  bool latent_denoising =
      true;  ///< skin and skeleton latents are deterministic and may be normalised; false: posteriors

  /// True when the latents of skin and skeleton lie on a sphere.
  bool normalizes() const { return latent_denoising && normalize_z; }

  void fields(ConfigFields& f);  ///< @throws NotSupportedError for serialized attention and rotary positions
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Arguments of AniGenElasticSLatMeshDecoder.
struct StructuredLatentDecoderOptions : StructuredLatentCoderOptions, JsonOptions<StructuredLatentDecoderOptions> {
  StructuredLatentDecoderOptions();
  bool skin_cross_from_groupped = false;    ///< the skin attends to the grouped joints
  std::int64_t h_skin_unet_num_levels = 4;  ///< of the U-Net behind the skin torso; below 1: none
  skin_field::SkinDecoderOptions skin_decoder_config;
  bool upsample_skl = false;  ///< the skeleton field at 4 R
  bool skl_defined_on_center =
      true;  ///< one vote per voxel; false: one per corner, averaged over the voxels that touch it
  bool use_color = false, use_conf_jp = false, use_conf_skin = false;  ///< representation_config
  std::string grouping_strategy = "mean_shift";                        ///< or "threshold"
  shape_field::MeshFieldOptions mesh_flags;  ///< its switches alone: vertex_skin_feat_…, flexicube_disable_deform

  /// Channels for the confidences of joint and parent.
  bool has_joint_confidence() const { return use_conf_jp || jp_hyper_continuous; }
  /// A channel of its own for the confidence of the skin feature.
  bool has_skin_confidence() const { return use_conf_skin && !jp_hyper_continuous; }
  std::int64_t skin_feat_channels() const { return skin_decoder_config.skin_feat_channels; }
  std::int64_t skeleton_resolution() const { return upsample_skl ? 4 * resolution : resolution; }
  /// Layout of the channels of a fine voxel.
  shape_field::MeshFieldOptions mesh_options() const;

  void fields(ConfigFields& f);  ///< @throws as for the encoder
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Normalisation of skin and skeleton latents, and of geometry latents that are those of a denoising auto-encoder.
enum class LatentNorm {
  kL2,   ///< as published
  kL1,   ///< as the paper says: the same directions, on the ℓ1 sphere
  kNone  ///< not at all
};

/// Variant of the structured-latent auto-encoder that a run trains, beyond what its models' arguments say. Ours, read
/// from `trainer.args`, also by whoever uses the trained models.
struct StructuredLatentVariant {
  skeleton_field::FieldConfidence confidence = skeleton_field::FieldConfidence::kExplicit;
  LatentNorm latent_norm = LatentNorm::kL2;
  bool joint_skin =
      false;  ///< `skin_ae` "joint": no pretrained SkinAE; its decoder is trained along, its encoder silent
  bool geometry_only = false;  ///< shape alone is trained
  bool geometry_dae = false;   ///< geometry latents are means, normalised and noised as the others; false: a posterior
  skeleton_field::MeanShiftForm grouping = skeleton_field::MeanShiftForm::kPublished;  ///< of votes, when decoded
  bool needs_skin_ae() const { return !joint_skin && !geometry_only; }

  /// `confidence` ("explicit", "none", "learned", "bayesian"; absent: what the models' arguments mean), `normalization`
  /// ("l2", "l1", "none"), `skin_ae` ("pretrained", "joint"), `geometry_only`, `geometry_latent` ("vae", "dae"),
  /// `grouping` ("published", "paper").
  /// @param compatibility "paper": normalization is "l1" and grouping "paper" unless given
  /// @throws InputError when they contradict
  static StructuredLatentVariant read(ConfigReader& trainer_args, const StructuredLatentDecoderOptions& decoder,
                                      const std::string& compatibility);
  /// As above, of a run folder's config. @param run the whole config @param file of it, for messages
  static StructuredLatentVariant of_run(const Json& run, const StructuredLatentDecoderOptions& decoder,
                                        const std::string& file);
  /// Changes by the switches to the models' arguments: `normalization` "none" turns normalize_z off.
  /// @throws InputError when "l1" is wanted of an encoder that does not normalise
  void apply(StructuredLatentEncoderOptions& encoder, const std::string& file) const;
};

/// Latents of skin or skeleton as the variant has them, from what the encoder gives. @param z [N, C] @return [N, C]
torch::Tensor renormalized(const torch::Tensor& z, const StructuredLatentEncoderOptions& encoder, LatentNorm norm);
/// Likewise of the geometry. @param z [N, C] posterior means where the variant is geometry_dae @return [N, C]
torch::Tensor geometry_latent(const torch::Tensor& z, const StructuredLatentEncoderOptions& encoder,
                              const StructuredLatentVariant& variant);

/// The field with confidences that grouping can compare with a threshold: for kBayesian e^(−s) divided by its 99th
/// percentile in the asset, at most 1 (docs/reference/training.md, 4); otherwise unchanged.
skeleton_field::SkeletonField for_grouping(const skeleton_field::SkeletonField& field,
                                           skeleton_field::FieldConfidence confidence);

}  // namespace anigen::structured_latent
