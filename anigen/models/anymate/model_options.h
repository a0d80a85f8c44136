#pragma once
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/models/anymate/concat_denoiser.h"
#include "anigen/models/anymate/cross_denoiser.h"
#include "anigen/models/anymate/head_options.h"
#include "anigen/models/anymate/latent_projection.h"
#include "anigen/models/anymate/michelangelo.h"
#include "anigen/models/anymate/point_bert.h"
#include "anigen/models/anymate/scratch_encoder.h"
#include "anigen/models/anymate/skinning_heads.h"
#include "anigen/models/anymate/style_generator.h"

namespace anigen::models::anymate {

enum class EncoderKind { kBert, kMichelangelo, kScratch };

enum class DecoderKind {
  kJointRegression,        ///< "Regress"
  kConcatDenoiser,         ///< "Diff-Concat"
  kCrossDenoiser,          ///< "Diff-Cross"
  kImplicitVolume,         ///< "Vol-Implicit"
  kTriplaneVolume,         ///< "Vol-TriPlane"
  kTokenConnectivity,      ///< "Token"
  kTwoBranchConnectivity,  ///< "2Branch"
  kConcatSkinning,         ///< "Concat"
  kCrossSkinning           ///< "Cross"
};

/// Released names: bert, miche, transformer.
const std::vector<std::string>& encoder_names();
/// Released names: transformer_latent, Pointe_Diffusion, Cross_Attention_Diffusion, implicit_transformer, triplane,
/// attendjoints_con_token, attendjoints_con_combine, attendjoints_multi, attendjoints_combine; in the order of
/// DecoderKind.
const std::vector<std::string>& decoder_names();
/// @throws InputError naming the nearest known name
EncoderKind encoder_kind(const std::string& name);
DecoderKind decoder_kind(const std::string& name);
const std::string& name_of(EncoderKind kind);
const std::string& name_of(DecoderKind kind);

/// What a decoder is for, and how it goes about it.
enum class Task { kJointRegression, kDenoisedJoints, kJointVolume, kConnectivity, kSkinning };
Task task_of(DecoderKind kind);

/// Sizes of a model; the defaults are the released ones (reference anymate-baselines.md, 2 to 5).
struct ModelOptions {
  EncoderKind encoder = EncoderKind::kBert;
  DecoderKind decoder = DecoderKind::kJointRegression;

  HeadOptions head;
  std::int64_t num_joints = 96, out_channels = 3;  ///< of the regression
  std::int64_t connectivity_layers = 2;            ///< of each branch
  std::int64_t token_layers = 4, head_token_length = 128;
  std::int64_t skinning_layers = 2;
  ConcatSkinningOptions concat_skinning;  ///< but `separate`, which is below
  bool separate = false;                  ///< skinning: one map for positions and normals
  ConcatDenoiserOptions concat_denoiser;
  CrossDenoiserOptions cross_denoiser;
  StyleGeneratorOptions triplane;

  PointBertOptions bert;
  ProjectionWidths projection;  ///< from Point-BERT's width to the head's
  MichelangeloOptions michelangelo;
  ScratchEncoderOptions scratch;
  bool load_encoder = false;  ///< Michelangelo taken from another model: its tokens pass through two more maps

  /// The whole released model of two names. @throws InputError for an unknown one
  static ModelOptions released(const std::string& encoder, const std::string& decoder);

  /// By the name of a released checkpoint, "<encoder>-<decoder>-….pth.tar". @throws InputError
  static ModelOptions from_checkpoint_name(const std::string& file_name);

  /// The `model:` block of a released config, which checkpoints carry as `model_config`: encoder, decoder, num_joints,
  /// out_channels, width, heads, init_scale, qkv_bias, separate, load_encoder; num_z, num_x, z_dim, x_dim, num_blocks,
  /// num_compute_layers, num_heads, mlp_ratio, num_latents, use_projection; n_ctx, layers, cond_drop_prob. `flash`,
  /// `num_x`, `n_ctx` and the keys of the diffusion schedule change nothing here. As released, width and heads do not
  /// reach the concatenation denoiser. Ours, for small models: objects `bert`, `michelangelo`, `scratch`,
  /// `concat_denoiser`, `concat_skinning` and `triplane` with the names of the options above, `projection_1` and
  /// `projection_2` within `bert`, and the numbers of layers and the head_token_length of this struct.
  /// @throws InputError for an unknown key or a value out of range
  static ModelOptions from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
};

/// The width of the latents that the decoder takes.
std::int64_t latent_width(const ModelOptions& options);

}  // namespace anigen::models::anymate
