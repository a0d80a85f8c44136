#include "anigen/sparse_structure/options.h"

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/sparse_structure/layers.h"

namespace anigen::sparse_structure {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostChannels = 16384;
constexpr std::int64_t kMostResBlocks = 256;
constexpr std::int64_t kMostTokens = 1 << 20;
constexpr std::int64_t kMostLevels = 7;  // 64³ cells down to one
constexpr std::int64_t kNormGroups = 32;

std::string pointer_below(const std::string& pointer, const char* key) { return pointer + "/" + key; }

}  // namespace

void SparseStructureCoderOptions::read(ConfigReader& reader) {
  latent_channels = reader.integer("latent_channels", latent_channels, 1, kMostChannels);
  latent_channels_skl = reader.integer("latent_channels_skl", latent_channels_skl, 1, kMostChannels);
  num_res_blocks = reader.integer("num_res_blocks", num_res_blocks, 0, kMostResBlocks);
  num_res_blocks_middle = reader.integer("num_res_blocks_middle", num_res_blocks_middle, 0, kMostResBlocks);
  reader.require("channels");
  channels = reader.integers("channels", {});
  norm_type = reader.choice("norm_type", norm_type, {"layer", "group"});
  use_fp16 = reader.boolean("use_fp16", use_fp16);
  encode_global = reader.boolean("encode_global", encode_global);
  encode_global_skl = reader.boolean("encode_global_skl", encode_global_skl);
  global_token_num = reader.integer("global_token_num", global_token_num, 1, kMostTokens);
  global_token_num_skl = reader.integer("global_token_num_skl", global_token_num_skl, 1, kMostTokens);
  use_pretrain_branch = reader.boolean("use_pretrain_branch", use_pretrain_branch);
  freeze_pretrain_branch = reader.boolean("freeze_pretrain_branch", freeze_pretrain_branch);
  modules_to_freeze = reader.texts("modules_to_freeze", modules_to_freeze);
  normalize_z = reader.boolean("normalize_z", normalize_z);
  normalize_z_skl = reader.boolean("normalize_z_skl", normalize_z_skl);
  normalize_scale = reader.number("normalize_scale", normalize_scale);
}

void SparseStructureCoderOptions::write(Json& json) const {
  json["latent_channels"] = latent_channels;
  json["latent_channels_skl"] = latent_channels_skl;
  json["num_res_blocks"] = num_res_blocks;
  json["num_res_blocks_middle"] = num_res_blocks_middle;
  json["channels"] = channels;
  json["norm_type"] = norm_type;
  json["use_fp16"] = use_fp16;
  json["encode_global"] = encode_global;
  json["encode_global_skl"] = encode_global_skl;
  json["global_token_num"] = global_token_num;
  json["global_token_num_skl"] = global_token_num_skl;
  json["use_pretrain_branch"] = use_pretrain_branch;
  json["freeze_pretrain_branch"] = freeze_pretrain_branch;
  json["modules_to_freeze"] = modules_to_freeze;
  json["normalize_z"] = normalize_z;
  json["normalize_z_skl"] = normalize_z_skl;
  json["normalize_scale"] = normalize_scale;
}

void SparseStructureCoderOptions::validate_coder(std::int64_t coarsest, std::int64_t last, const std::string& file,
                                                 const std::string& pointer) const {
  if (!(normalize_scale > 0.0)) {
    throw InputError(file, pointer_below(pointer, "normalize_scale"), "must be above 0");
  }
  if (coarsest % kGlobalTokenHeads != 0 && (encode_global || encode_global_skl)) {
    throw InputError(file, pointer_below(pointer, "channels"),
                     "with encode_global the coarsest width must be a multiple of " +
                         std::to_string(kGlobalTokenHeads) + " heads, found " + std::to_string(coarsest));
  }
  if (norm_type == "group" && last % kNormGroups != 0) {
    throw InputError(file, pointer_below(pointer, "norm_type"),
                     std::to_string(last) + " channels are not a multiple of " + std::to_string(kNormGroups) +
                         " groups; use \"layer\"");
  }
}

namespace {

void check_channels(const SparseStructureCoderOptions& options, const std::string& file, const std::string& pointer) {
  const std::string place = pointer_below(pointer, "channels");
  if (options.channels.empty() || options.levels() > kMostLevels) {
    throw InputError(file, place, "expected 1 to " + std::to_string(kMostLevels) + " widths");
  }
  for (const std::int64_t width : options.channels) {
    if (width < 1 || width > kMostChannels) throw InputError(file, place, "bad width " + std::to_string(width));
  }
}

}  // namespace

SparseStructureEncoderOptions SparseStructureEncoderOptions::from_json(const Json& json, const std::string& file,
                                                                       const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  SparseStructureEncoderOptions options;
  options.in_channels = reader.integer("in_channels", options.in_channels, 1, kMostChannels);
  options.in_channels_skl = reader.integer("in_channels_skl", options.in_channels_skl, 1, kMostChannels);
  options.read(reader);
  options.latent_denoising = reader.boolean("latent_denoising", options.latent_denoising);
  options.latent_denoising_skl = reader.boolean("latent_denoising_skl", options.latent_denoising_skl);
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json SparseStructureEncoderOptions::to_json() const {
  Json json;
  json["in_channels"] = in_channels;
  json["in_channels_skl"] = in_channels_skl;
  write(json);
  json["latent_denoising"] = latent_denoising;
  json["latent_denoising_skl"] = latent_denoising_skl;
  return json;
}

void SparseStructureEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  check_channels(*this, file, pointer);
  validate_coder(channels.back(), channels.back(), file, pointer);
}

SparseStructureDecoderOptions SparseStructureDecoderOptions::from_json(const Json& json, const std::string& file,
                                                                       const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  SparseStructureDecoderOptions options;
  options.out_channels = reader.integer("out_channels", options.out_channels, 1, kMostChannels);
  options.out_channels_skl = reader.integer("out_channels_skl", options.out_channels_skl, 1, kMostChannels);
  options.read(reader);
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json SparseStructureDecoderOptions::to_json() const {
  Json json;
  json["out_channels"] = out_channels;
  json["out_channels_skl"] = out_channels_skl;
  write(json);
  return json;
}

void SparseStructureDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  check_channels(*this, file, pointer);
  validate_coder(channels.front(), channels.back(), file, pointer);
  const auto check_first_block = [&](bool global, std::int64_t latent, const char* key) {
    if (!global || (channels.front() + latent) % kGlobalTokenFirstHeads == 0) return;
    throw InputError(file, pointer_below(pointer, key),
                     "with encode_global the first width and this must sum to a multiple of " +
                         std::to_string(kGlobalTokenFirstHeads) + " heads");
  };
  check_first_block(encode_global, latent_channels, "latent_channels");
  check_first_block(encode_global_skl, latent_channels_skl, "latent_channels_skl");
}

}  // namespace anigen::sparse_structure
