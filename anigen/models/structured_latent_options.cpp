#include "anigen/models/structured_latent_options.h"

#include <cmath>
#include <cstddef>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::models {
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
  options.skin_encoder_config = nested<SkinEncoderOptions>(reader, "skin_encoder_config");
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
  bool fields::MeshFieldOptions::*value;
};
constexpr MeshSwitch kMeshSwitches[] = {
    {"vertex_skin_feat_interp_sparse", &fields::MeshFieldOptions::skin_interp_sparse},
    {"vertex_skin_feat_interp_nearest", &fields::MeshFieldOptions::skin_interp_nearest},
    {"vertex_skin_feat_interp_use_deformed_grid", &fields::MeshFieldOptions::skin_interp_use_deformed_grid},
    {"vertex_skin_feat_interp_trilinear", &fields::MeshFieldOptions::skin_interp_trilinear},
    {"flexicube_disable_deform", &fields::MeshFieldOptions::disable_deform},
    {"vertex_skin_feat_nodeform_trilinear", &fields::MeshFieldOptions::skin_nodeform_trilinear}};

}  // namespace

StructuredLatentDecoderOptions StructuredLatentDecoderOptions::from_json(const Json& json, const std::string& file,
                                                                         const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  StructuredLatentDecoderOptions options;
  options.read(reader);
  options.skin_cross_from_groupped = reader.boolean("skin_cross_from_groupped", options.skin_cross_from_groupped);
  options.h_skin_unet_num_levels =
      reader.integer("h_skin_unet_num_levels", options.h_skin_unet_num_levels, -kMostUnetLevels, kMostUnetLevels);
  options.skin_decoder_config = nested<SkinDecoderOptions>(reader, "skin_decoder_config");
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

fields::MeshFieldOptions StructuredLatentDecoderOptions::mesh_options() const {
  fields::MeshFieldOptions mesh = mesh_flags;
  mesh.resolution = 4 * resolution;
  mesh.use_color = use_color;
  mesh.skin_channels = skin_feat_channels();
  return mesh;
}

}  // namespace anigen::models
