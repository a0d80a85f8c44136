#include "anigen/structured_latent/options.h"

#include <cmath>
#include <cstddef>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
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

// An integer that may also be null in the published signature: 0 then.
std::int64_t optional_integer(ConfigReader& reader, const char* key, std::int64_t fallback, std::int64_t highest) {
  const Json* value = reader.raw(key);
  if (value != nullptr && value->is_null()) return 0;
  return reader.integer(key, fallback, 1, highest);
}

std::int64_t required_integer(ConfigReader& reader, const char* key, std::int64_t highest) {
  reader.require(key);
  return reader.integer(key, 0, 1, highest);
}

// The published modes beside these order the voxels along a curve.
std::string attention_mode(ConfigReader& reader, const char* key, const std::string& fallback) {
  const std::string mode =
      reader.choice(key, fallback, {"full", "swin", "shift_window", "shift_sequence", "shift_order", "serialized"});
  if (mode == "full" || mode == "swin") return mode;
  throw NotSupportedError(reader.file(), reader.pointer_to(key), "serialized attention ('" + mode + "')");
}

// A nested object that another class reads.
template <typename Options>
Options nested(ConfigReader& reader, const char* key) {
  const Json* value = reader.raw(key);
  return Options::from_json(value == nullptr ? Json::object() : *value, reader.file(), reader.pointer_to(key));
}

void check_slat(bool valid, const std::string& file, const std::string& place, const std::string& problem) {
  if (!valid) throw InputError(file, place, problem);
}

void check_heads(std::int64_t channels, std::int64_t heads, const std::string& file, const std::string& place) {
  check_slat(heads > 0 && channels % heads == 0, file, place,
             std::to_string(heads) + " heads do not divide " + std::to_string(channels) + " channels");
}

void check_groups(std::int64_t channels, const std::string& file, const std::string& place, const std::string& why) {
  check_slat(channels > 0 && channels % kSlatNormGroups == 0, file, place,
             std::to_string(channels) + " channels are not a multiple of " + std::to_string(kSlatNormGroups) +
                 " groups, which " + why + " needs");
}

}  // namespace

void StructuredLatentCoderOptions::read(ConfigReader& reader) {
  resolution = required_integer(reader, "resolution", kMostSlatResolution);
  model_channels = required_integer(reader, "model_channels", kMostSlatChannels);
  model_channels_skl = required_integer(reader, "model_channels_skl", kMostSlatChannels);
  model_channels_skin = required_integer(reader, "model_channels_skin", kMostSlatChannels);
  latent_channels = required_integer(reader, "latent_channels", kMostSlatChannels);
  latent_channels_skl = required_integer(reader, "latent_channels_skl", kMostSlatChannels);
  latent_channels_vertskin = required_integer(reader, "latent_channels_vertskin", kMostSlatChannels);
  reader.require("num_blocks");
  num_blocks = reader.integer("num_blocks", 0, 0, kMostSlatBlocks);
  num_heads = optional_integer(reader, "num_heads", num_heads, kMostSlatChannels);
  num_head_channels = optional_integer(reader, "num_head_channels", num_head_channels, kMostSlatChannels);
  num_heads_skl = reader.integer("num_heads_skl", num_heads_skl, 1, kMostSlatChannels);
  num_heads_skin = reader.integer("num_heads_skin", num_heads_skin, 1, kMostSlatChannels);
  mlp_ratio = reader.number("mlp_ratio", mlp_ratio, 0.0, 64.0);
  attn_mode = attention_mode(reader, "attn_mode", attn_mode);
  attn_mode_cross = attention_mode(reader, "attn_mode_cross", attn_mode_cross);
  window_size = reader.integer("window_size", window_size, 1, kMostSlatResolution);
  if (reader.choice("pe_mode", "ape", {"ape", "rope"}) == "rope") {
    throw NotSupportedError(reader.file(), reader.pointer_to("pe_mode"), "rotary positions ('rope')");
  }
  use_fp16 = reader.boolean("use_fp16", use_fp16);
  use_checkpoint = reader.boolean("use_checkpoint", use_checkpoint);
  qk_rms_norm = reader.boolean("qk_rms_norm", qk_rms_norm);
  skin_cross_from_geo = reader.boolean("skin_cross_from_geo", skin_cross_from_geo);
  skl_cross_from_geo = reader.boolean("skl_cross_from_geo", skl_cross_from_geo);
  skin_skl_cross = reader.boolean("skin_skl_cross", skin_skl_cross);
  use_pretrain_branch = reader.boolean("use_pretrain_branch", use_pretrain_branch);
  freeze_pretrain_branch = reader.boolean("freeze_pretrain_branch", freeze_pretrain_branch);
  modules_to_freeze = reader.texts("modules_to_freeze", modules_to_freeze);
  skin_ae_name = reader.text("skin_ae_name", skin_ae_name);
  normalize_z = reader.boolean("normalize_z", normalize_z);
  normalize_scale = reader.number("normalize_scale", normalize_scale);
  jp_residual_fields = reader.boolean("jp_residual_fields", jp_residual_fields);
  jp_hyper_continuous = reader.boolean("jp_hyper_continuous", jp_hyper_continuous);
}

void StructuredLatentCoderOptions::write(Json& json) const {
  const auto or_null = [](std::int64_t value) { return value > 0 ? Json(value) : Json(nullptr); };
  json["resolution"] = resolution;
  json["model_channels"] = model_channels;
  json["model_channels_skl"] = model_channels_skl;
  json["model_channels_skin"] = model_channels_skin;
  json["latent_channels"] = latent_channels;
  json["latent_channels_skl"] = latent_channels_skl;
  json["latent_channels_vertskin"] = latent_channels_vertskin;
  json["num_blocks"] = num_blocks;
  json["num_heads"] = or_null(num_heads);
  json["num_head_channels"] = or_null(num_head_channels);
  json["num_heads_skl"] = num_heads_skl;
  json["num_heads_skin"] = num_heads_skin;
  json["mlp_ratio"] = mlp_ratio;
  json["attn_mode"] = attn_mode;
  json["attn_mode_cross"] = attn_mode_cross;
  json["window_size"] = window_size;
  json["pe_mode"] = "ape";
  json["use_fp16"] = use_fp16;
  json["use_checkpoint"] = use_checkpoint;
  json["qk_rms_norm"] = qk_rms_norm;
  json["skin_cross_from_geo"] = skin_cross_from_geo;
  json["skl_cross_from_geo"] = skl_cross_from_geo;
  json["skin_skl_cross"] = skin_skl_cross;
  json["use_pretrain_branch"] = use_pretrain_branch;
  json["freeze_pretrain_branch"] = freeze_pretrain_branch;
  json["modules_to_freeze"] = modules_to_freeze;
  json["skin_ae_name"] = skin_ae_name;
  json["normalize_z"] = normalize_z;
  json["normalize_scale"] = normalize_scale;
  json["jp_residual_fields"] = jp_residual_fields;
  json["jp_hyper_continuous"] = jp_hyper_continuous;
}

void StructuredLatentCoderOptions::validate_coder(const std::string& file, const std::string& pointer) const {
  check_slat(num_heads > 0 || num_head_channels > 0, file, pointer + "/num_heads",
             "num_heads or num_head_channels must be given");
  check_heads(model_channels, heads(), file, pointer + "/num_heads");
  check_heads(model_channels_skl, num_heads_skl, file, pointer + "/num_heads_skl");
  check_heads(model_channels_skin, num_heads_skin, file, pointer + "/num_heads_skin");
  for (const std::int64_t width : {model_channels, model_channels_skl, model_channels_skin}) {
    check_slat(std::floor(static_cast<double>(width) * mlp_ratio) >= 1.0, file, pointer + "/mlp_ratio",
               "leaves no hidden channel");
  }
  check_slat(normalize_scale > 0.0, file, pointer + "/normalize_scale", "must be above 0");
}

StructuredLatentEncoderOptions::StructuredLatentEncoderOptions() {
  skin_cross_from_geo = skl_cross_from_geo = skin_skl_cross = true;
  normalize_z = true;
  jp_residual_fields = jp_hyper_continuous = false;
  modules_to_freeze = {"input_layer", "blocks", "out_layer", "skin_encoder"};
}

StructuredLatentEncoderOptions StructuredLatentEncoderOptions::from_json(const Json& json, const std::string& file,
                                                                         const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  StructuredLatentEncoderOptions options;
  options.read(reader);
  options.in_channels = required_integer(reader, "in_channels", kMostSlatChannels);
  options.skl_pos_embed_freq = reader.integer("skl_pos_embed_freq", options.skl_pos_embed_freq, 1, kMostSlatBands);
  options.skin_encoder_config = nested<skin_field::SkinEncoderOptions>(reader, "skin_encoder_config");
  options.encode_upsampled_skin_feat = reader.boolean("encode_upsampled_skin_feat", options.encode_upsampled_skin_feat);
  options.latent_denoising = reader.boolean("latent_denoising", options.latent_denoising);
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json StructuredLatentEncoderOptions::to_json() const {
  Json json;
  write(json);
  json["in_channels"] = in_channels;
  json["skl_pos_embed_freq"] = skl_pos_embed_freq;
  json["skin_encoder_config"] = skin_encoder_config.to_json();
  json["encode_upsampled_skin_feat"] = encode_upsampled_skin_feat;
  json["latent_denoising"] = latent_denoising;
  return json;
}

void StructuredLatentEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  validate_coder(file, pointer);
  skin_encoder_config.validate(file, pointer + "/skin_encoder_config");
  check_slat(model_channels_skl >= 4, file, pointer + "/model_channels_skl",
             "must be at least 4: a quarter of it is for joints and parents");
}

StructuredLatentDecoderOptions::StructuredLatentDecoderOptions() {
  modules_to_freeze = {"blocks", "upsample", "out_layer", "skin_decoder"};
}

namespace {

// The switches of the mesh extraction under their published names.
struct MeshSwitch {
  const char* key;
  bool shape_field::MeshFieldOptions::*value;
};
constexpr MeshSwitch kMeshSwitches[] = {
    {"vertex_skin_feat_interp_sparse", &shape_field::MeshFieldOptions::skin_interp_sparse},
    {"vertex_skin_feat_interp_nearest", &shape_field::MeshFieldOptions::skin_interp_nearest},
    {"vertex_skin_feat_interp_use_deformed_grid", &shape_field::MeshFieldOptions::skin_interp_use_deformed_grid},
    {"vertex_skin_feat_interp_trilinear", &shape_field::MeshFieldOptions::skin_interp_trilinear},
    {"flexicube_disable_deform", &shape_field::MeshFieldOptions::disable_deform},
    {"vertex_skin_feat_nodeform_trilinear", &shape_field::MeshFieldOptions::skin_nodeform_trilinear}};

}  // namespace

StructuredLatentDecoderOptions StructuredLatentDecoderOptions::from_json(const Json& json, const std::string& file,
                                                                         const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  StructuredLatentDecoderOptions options;
  options.read(reader);
  options.skin_cross_from_groupped = reader.boolean("skin_cross_from_groupped", options.skin_cross_from_groupped);
  options.h_skin_unet_num_levels =
      reader.integer("h_skin_unet_num_levels", options.h_skin_unet_num_levels, -kMostUnetLevels, kMostUnetLevels);
  options.skin_decoder_config = nested<skin_field::SkinDecoderOptions>(reader, "skin_decoder_config");
  options.upsample_skl = reader.boolean("upsample_skl", options.upsample_skl);
  options.skl_defined_on_center = reader.boolean("skl_defined_on_center", options.skl_defined_on_center);
  ConfigReader representation = reader.object("representation_config");
  options.use_color = representation.boolean("use_color", options.use_color);
  options.use_conf_jp = representation.boolean("use_conf_jp", options.use_conf_jp);
  options.use_conf_skin = representation.boolean("use_conf_skin", options.use_conf_skin);
  representation.finish();
  options.grouping_strategy =
      reader.choice("grouping_strategy", options.grouping_strategy, {"mean_shift", "threshold"});
  for (const MeshSwitch& item : kMeshSwitches) {
    options.mesh_flags.*item.value = reader.boolean(item.key, options.mesh_flags.*item.value);
  }
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json StructuredLatentDecoderOptions::to_json() const {
  Json representation;
  representation["use_color"] = use_color;
  representation["use_conf_jp"] = use_conf_jp;
  representation["use_conf_skin"] = use_conf_skin;
  Json json;
  write(json);
  json["skin_cross_from_groupped"] = skin_cross_from_groupped;
  json["h_skin_unet_num_levels"] = h_skin_unet_num_levels;
  json["skin_decoder_config"] = skin_decoder_config.to_json();
  json["upsample_skl"] = upsample_skl;
  json["skl_defined_on_center"] = skl_defined_on_center;
  json["representation_config"] = representation;
  json["grouping_strategy"] = grouping_strategy;
  for (const MeshSwitch& item : kMeshSwitches) json[item.key] = mesh_flags.*item.value;
  return json;
}

void StructuredLatentDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  validate_coder(file, pointer);
  skin_decoder_config.validate(file, pointer + "/skin_decoder_config");
  check_slat(model_channels % 8 == 0, file, pointer + "/model_channels", "must be a multiple of 8");
  check_groups(model_channels / 8, file, pointer + "/model_channels", "the up-sampling (an eighth of this width)");
  check_groups(model_channels_skin, file, pointer + "/model_channels_skin", "the up-sampling");
  if (upsample_skl) check_groups(model_channels_skl, file, pointer + "/model_channels_skl", "upsample_skl");
}

shape_field::MeshFieldOptions StructuredLatentDecoderOptions::mesh_options() const {
  shape_field::MeshFieldOptions mesh = mesh_flags;
  mesh.resolution = 4 * resolution;
  mesh.use_color = use_color;
  mesh.skin_channels = skin_feat_channels();
  return mesh;
}

namespace {

using torch::Tensor;

constexpr double kReferencePercentile = 0.99;
constexpr double kLeastLength = 1e-12;

skeleton_field::FieldConfidence derived_confidence(const StructuredLatentDecoderOptions& decoder) {
  if (decoder.jp_hyper_continuous) return skeleton_field::FieldConfidence::kExplicit;
  return decoder.has_joint_confidence() ? skeleton_field::FieldConfidence::kLearned
                                        : skeleton_field::FieldConfidence::kNone;
}

const char* word_of(skeleton_field::FieldConfidence confidence) {
  switch (confidence) {
    case skeleton_field::FieldConfidence::kExplicit:
      return "explicit";
    case skeleton_field::FieldConfidence::kNone:
      return "none";
    case skeleton_field::FieldConfidence::kLearned:
      return "learned";
    default:
      return "bayesian";
  }
}

Tensor relative_precision(const Tensor& log_scale) {
  if (!log_scale.defined() || log_scale.numel() == 0) return log_scale;
  const Tensor precision = torch::exp(-skeleton_field::clamped_log_scale(log_scale.to(torch::kFloat32)));
  return (precision / torch::quantile(precision.reshape({-1}), kReferencePercentile)).clamp_max(1.0);
}

}  // namespace

StructuredLatentVariant StructuredLatentVariant::read(ConfigReader& args, const StructuredLatentDecoderOptions& decoder,
                                                      const std::string& compatibility) {
  StructuredLatentVariant variant;
  const skeleton_field::FieldConfidence derived = derived_confidence(decoder);
  const std::string word = args.choice("confidence", word_of(derived), {"explicit", "none", "learned", "bayesian"});
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

skeleton_field::SkeletonField for_grouping(const skeleton_field::SkeletonField& field,
                                           skeleton_field::FieldConfidence confidence) {
  if (confidence != skeleton_field::FieldConfidence::kBayesian) return field;
  skeleton_field::SkeletonField mapped = field;
  mapped.conf_j = relative_precision(field.conf_j);
  mapped.conf_p = relative_precision(field.conf_p);
  return mapped;
}

}  // namespace anigen::structured_latent
