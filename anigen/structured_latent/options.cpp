#include "anigen/structured_latent/options.h"

#include <cmath>
#include <cstddef>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/norms.h"
#include "anigen/skeleton_field/loss.h"

namespace anigen::structured_latent {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostSlatChannels = 16384;
constexpr std::int64_t kMostSlatBlocks = 256;
constexpr std::int64_t kMostSlatResolution = 4096;
constexpr std::int64_t kMostSlatBands = 64;
constexpr std::int64_t kMostUnetLevels = 12;
constexpr std::int64_t kSlatNormGroups = 32;

// The published modes beside these order the voxels along a curve.
void attention_mode(ConfigFields& f, const char* key, std::string& mode) {
  f(key, mode, {"full", "swin", "shift_window", "shift_sequence", "shift_order", "serialized"});
  if (mode != "full" && mode != "swin") throw f.not_supported(key, "serialized attention ('" + mode + "')");
}

void check_groups(const OptionCheck& check, const char* key, std::int64_t channels, const std::string& why) {
  check(channels > 0 && channels % kSlatNormGroups == 0, key,
        std::to_string(channels) + " channels are not a multiple of " + std::to_string(kSlatNormGroups) +
            " groups, which " + why + " needs");
}

using torch::Tensor;

constexpr double kReferencePercentile = 0.99;
constexpr double kLeastLength = 1e-12;

skeleton_field::FieldConfidence derived_confidence(const StructuredLatentDecoderOptions& decoder) {
  if (decoder.jp_hyper_continuous) return skeleton_field::FieldConfidence::kExplicit;
  return decoder.has_joint_confidence() ? skeleton_field::FieldConfidence::kLearned
                                        : skeleton_field::FieldConfidence::kNone;
}

// In the order of the enum.
const std::vector<std::string>& confidence_words() {
  static const std::vector<std::string> words = {"explicit", "none", "learned", "bayesian"};
  return words;
}

const std::string& word_of(skeleton_field::FieldConfidence confidence) {
  return confidence_words()[static_cast<std::size_t>(confidence)];
}

Tensor relative_precision(const Tensor& log_scale) {
  if (!log_scale.defined() || log_scale.numel() == 0) return log_scale;
  const Tensor precision = torch::exp(-skeleton_field::clamped_log_scale(log_scale.to(torch::kFloat32)));
  return (precision / torch::quantile(precision.reshape({-1}), kReferencePercentile)).clamp_max(1.0);
}

}  // namespace

void StructuredLatentCoderOptions::fields(ConfigFields& f) {
  f("resolution", resolution, {1, kMostSlatResolution}, kRequired);
  f("model_channels", model_channels, {1, kMostSlatChannels}, kRequired);
  f("model_channels_skl", model_channels_skl, {1, kMostSlatChannels}, kRequired);
  f("model_channels_skin", model_channels_skin, {1, kMostSlatChannels}, kRequired);
  f("latent_channels", latent_channels, {1, kMostSlatChannels}, kRequired);
  f("latent_channels_skl", latent_channels_skl, {1, kMostSlatChannels}, kRequired);
  f("latent_channels_vertskin", latent_channels_vertskin, {1, kMostSlatChannels}, kRequired);
  f("num_blocks", num_blocks, {0, kMostSlatBlocks}, kRequired);
  f.or_null("num_heads", num_heads, {1, kMostSlatChannels});
  f.or_null("num_head_channels", num_head_channels, {1, kMostSlatChannels});
  f("num_heads_skl", num_heads_skl, {1, kMostSlatChannels});
  f("num_heads_skin", num_heads_skin, {1, kMostSlatChannels});
  f("mlp_ratio", mlp_ratio, {0.0, 64.0});
  attention_mode(f, "attn_mode", attn_mode);
  attention_mode(f, "attn_mode_cross", attn_mode_cross);
  f("window_size", window_size, {1, kMostSlatResolution});
  std::string pe_mode = "ape";
  f("pe_mode", pe_mode, {"ape", "rope"});
  if (pe_mode == "rope") throw f.not_supported("pe_mode", "rotary positions ('rope')");
  f("use_fp16", use_fp16);
  f("use_checkpoint", use_checkpoint);
  f("qk_rms_norm", qk_rms_norm);
  f("skin_cross_from_geo", skin_cross_from_geo);
  f("skl_cross_from_geo", skl_cross_from_geo);
  f("skin_skl_cross", skin_skl_cross);
  f("use_pretrain_branch", use_pretrain_branch);
  f("freeze_pretrain_branch", freeze_pretrain_branch);
  f("modules_to_freeze", modules_to_freeze);
  f("skin_ae_name", skin_ae_name);
  f("normalize_z", normalize_z);
  f("normalize_scale", normalize_scale);
  f("jp_residual_fields", jp_residual_fields);
  f("jp_hyper_continuous", jp_hyper_continuous);
}

void StructuredLatentCoderOptions::validate_coder(const OptionCheck& check) const {
  check(num_heads > 0 || num_head_channels > 0, "num_heads", "num_heads or num_head_channels must be given");
  check.heads("num_heads", heads(), model_channels);
  check.heads("num_heads_skl", num_heads_skl, model_channels_skl);
  check.heads("num_heads_skin", num_heads_skin, model_channels_skin);
  for (const std::int64_t width : {model_channels, model_channels_skl, model_channels_skin})
    check(std::floor(static_cast<double>(width) * mlp_ratio) >= 1.0, "mlp_ratio", "leaves no hidden channel");
  check(normalize_scale > 0.0, "normalize_scale", "must be above 0");
}

StructuredLatentEncoderOptions::StructuredLatentEncoderOptions() {
  skin_cross_from_geo = skl_cross_from_geo = skin_skl_cross = true;
  normalize_z = true;
  jp_residual_fields = jp_hyper_continuous = false;
  modules_to_freeze = {"input_layer", "blocks", "out_layer", "skin_encoder"};
}

void StructuredLatentEncoderOptions::fields(ConfigFields& f) {
  StructuredLatentCoderOptions::fields(f);
  f("in_channels", in_channels, {1, kMostSlatChannels}, kRequired);
  f("skl_pos_embed_freq", skl_pos_embed_freq, {1, kMostSlatBands});
  f.object("skin_encoder_config", skin_encoder_config);
  f("encode_upsampled_skin_feat", encode_upsampled_skin_feat);
  f("latent_denoising", latent_denoising);
}

void StructuredLatentEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  validate_coder(check);
  skin_encoder_config.validate(file, pointer + "/skin_encoder_config");
  check(model_channels_skl >= 4, "model_channels_skl", "must be at least 4: a quarter of it is for joints and parents");
}

StructuredLatentDecoderOptions::StructuredLatentDecoderOptions() {
  modules_to_freeze = {"blocks", "upsample", "out_layer", "skin_decoder"};
}

void StructuredLatentDecoderOptions::fields(ConfigFields& f) {
  StructuredLatentCoderOptions::fields(f);
  f("skin_cross_from_groupped", skin_cross_from_groupped);
  f("h_skin_unet_num_levels", h_skin_unet_num_levels, {-kMostUnetLevels, kMostUnetLevels});
  f.object("skin_decoder_config", skin_decoder_config);
  f("upsample_skl", upsample_skl);
  f("skl_defined_on_center", skl_defined_on_center);
  f.object("representation_config", [this](ConfigFields& representation) {
    representation("use_color", use_color);
    representation("use_conf_jp", use_conf_jp);
    representation("use_conf_skin", use_conf_skin);
  });
  f("grouping_strategy", grouping_strategy, {"mean_shift", "threshold"});
  f("vertex_skin_feat_interp_sparse", mesh_flags.skin_interp_sparse);
  f("vertex_skin_feat_interp_nearest", mesh_flags.skin_interp_nearest);
  f("vertex_skin_feat_interp_use_deformed_grid", mesh_flags.skin_interp_use_deformed_grid);
  f("vertex_skin_feat_interp_trilinear", mesh_flags.skin_interp_trilinear);
  f("flexicube_disable_deform", mesh_flags.disable_deform);
  f("vertex_skin_feat_nodeform_trilinear", mesh_flags.skin_nodeform_trilinear);
}

void StructuredLatentDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  validate_coder(check);
  skin_decoder_config.validate(file, pointer + "/skin_decoder_config");
  check(model_channels % 8 == 0, "model_channels", "must be a multiple of 8");
  check_groups(check, "model_channels", model_channels / 8, "the up-sampling (an eighth of this width)");
  check_groups(check, "model_channels_skin", model_channels_skin, "the up-sampling");
  if (upsample_skl) check_groups(check, "model_channels_skl", model_channels_skl, "upsample_skl");
}

shape_field::MeshFieldOptions StructuredLatentDecoderOptions::mesh_options() const {
  shape_field::MeshFieldOptions mesh = mesh_flags;
  mesh.resolution = 4 * resolution;
  mesh.use_color = use_color;
  mesh.skin_channels = skin_feat_channels();
  return mesh;
}

StructuredLatentVariant StructuredLatentVariant::read(ConfigReader& args, const StructuredLatentDecoderOptions& decoder,
                                                      const std::string& compatibility) {
  StructuredLatentVariant variant;
  const skeleton_field::FieldConfidence derived = derived_confidence(decoder);
  const std::string word = args.choice("confidence", word_of(derived), confidence_words());
  variant.confidence = derived;
  if (word == "bayesian") {
    if (derived != skeleton_field::FieldConfidence::kLearned) {
      throw args.error(
          "confidence",
          "\"bayesian\" needs models with jp_hyper_continuous false and use_conf_jp true, whose confidence "
          "channels are free");
    }
    variant.confidence = skeleton_field::FieldConfidence::kBayesian;
  } else if (word != word_of(derived)) {
    throw args.error("confidence", "\"" + word +
                                       "\" contradicts the models, whose jp_hyper_continuous and use_conf_jp "
                                       "mean \"" +
                                       word_of(derived) + "\"");
  }
  const std::string norm = args.choice("normalization", compatibility == "paper" ? "l1" : "l2", {"l2", "l1", "none"});
  variant.latent_norm = norm == "l1" ? LatentNorm::kL1 : norm == "none" ? LatentNorm::kNone : LatentNorm::kL2;
  variant.joint_skin = args.choice("skin_ae", "pretrained", {"pretrained", "joint"}) == "joint";
  variant.geometry_only = args.boolean("geometry_only", false);
  variant.geometry_dae = args.choice("geometry_latent", "vae", {"vae", "dae"}) == "dae";
  const std::string by_default = compatibility == "paper" ? "paper" : "published";
  const bool paper = args.choice("grouping", by_default, {"published", "paper"}) == "paper";
  variant.grouping = paper ? skeleton_field::MeanShiftForm::kPaper : skeleton_field::MeanShiftForm::kPublished;
  return variant;
}

StructuredLatentVariant StructuredLatentVariant::of_run(const Json& run, const StructuredLatentDecoderOptions& decoder,
                                                        const std::string& file) {
  ConfigReader top(run, file);
  ConfigReader args = top.object("trainer").object("args");
  return read(args, decoder, args.text("compatibility", "published"));
}

void StructuredLatentVariant::apply(StructuredLatentEncoderOptions& encoder, const std::string& file) const {
  if (latent_norm == LatentNorm::kNone) encoder.normalize_z = false;
  if (latent_norm == LatentNorm::kL1 && !encoder.normalizes()) {
    throw InputError(file, "/trainer/args/normalization",
                     "\"l1\" needs an encoder with latent_denoising and normalize_z");
  }
}

Tensor renormalized(const Tensor& z, const StructuredLatentEncoderOptions& encoder, LatentNorm norm) {
  if (norm != LatentNorm::kL1) return z;
  return encoder.normalize_scale * z / z.abs().sum(-1, /*keepdim=*/true).clamp_min(kLeastLength);
}

Tensor geometry_latent(const Tensor& z, const StructuredLatentEncoderOptions& encoder,
                       const StructuredLatentVariant& variant) {
  if (!variant.geometry_dae || variant.latent_norm == LatentNorm::kNone) return z;
  if (variant.latent_norm == LatentNorm::kL1) return renormalized(z, encoder, LatentNorm::kL1);
  return encoder.normalize_scale * nn::unit_length(z);
}

skeleton_field::SkeletonField for_grouping(const skeleton_field::SkeletonField& field,
                                           skeleton_field::FieldConfidence confidence) {
  if (confidence != skeleton_field::FieldConfidence::kBayesian) return field;
  skeleton_field::SkeletonField mapped = field;
  mapped.conf_j = relative_precision(field.conf_j);
  mapped.conf_p = relative_precision(field.conf_p);
  return mapped;
}

}  // namespace anigen::structured_latent
