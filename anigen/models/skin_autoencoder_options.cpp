#include "anigen/models/skin_autoencoder_options.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/models/joint_embedder.h"

namespace anigen::models {
namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMaxWidth = 16384;
constexpr std::int64_t kMaxBlocks = 256;
constexpr std::int64_t kMaxBands = 64;

void check(bool valid, const std::string& file, const std::string& place, const std::string& problem) {
  if (!valid) throw InputError(file, place, problem);
}

JointEmbedderOptions read_joint_embedder(ConfigReader reader) {
  JointEmbedderOptions options;
  options.hidden_dim = reader.integer("hidden_dim", options.hidden_dim, 1, kMaxWidth);
  options.depth = reader.integer("depth", options.depth, 0, kMaxBlocks);
  options.jp_embed_attn = reader.boolean("jp_embed_attn", options.jp_embed_attn);
  options.mlp_ratio = reader.number("mlp_ratio", options.mlp_ratio, 0.0, 64.0);
  reader.finish();
  return options;
}

SkinEncoderOptions read_encoder(ConfigReader reader) {
  SkinEncoderOptions options;
  options.skin_feat_channels = reader.integer("skin_feat_channels", options.skin_feat_channels, 1, kMaxWidth);
  options.skl_pos_embed_freq = reader.integer("skl_pos_embed_freq", options.skl_pos_embed_freq, 1, kMaxBands);
  options.jp_embed_dim = reader.integer("jp_embed_dim", options.jp_embed_dim, 1, kMaxWidth);
  options.jp_embedder_config = read_joint_embedder(reader.object("jp_embedder_config"));
  options.relative_pe = reader.boolean("relative_pe", options.relative_pe);
  options.vert_feat_is_linear = reader.boolean("vert_feat_is_linear", options.vert_feat_is_linear);
  options.normalize_feat = reader.boolean("normalize_feat", options.normalize_feat);
  reader.finish();
  return options;
}

SkinDecoderOptions read_decoder(ConfigReader reader) {
  SkinDecoderOptions options;
  options.model_type = reader.text("model_type", options.model_type);
  options.skin_feat_channels = reader.integer("skin_feat_channels", options.skin_feat_channels, 1, kMaxWidth);
  options.model_channels = reader.integer("model_channels", options.model_channels, 1, kMaxWidth);
  options.num_blocks = reader.integer("num_blocks", options.num_blocks, 0, kMaxBlocks);
  options.num_heads = reader.integer("num_heads", options.num_heads, 1, kMaxWidth);
  options.vert_cross_blocks_num = reader.integer("vert_cross_blocks_num", options.vert_cross_blocks_num, 0, kMaxBlocks);
  reader.finish();
  return options;
}

}  // namespace

SkinEncoderOptions SkinEncoderOptions::from_json(const Json& json, const std::string& file,
                                                 const std::string& pointer) {
  const SkinEncoderOptions options = read_encoder(ConfigReader(json, file, pointer));
  options.validate(file, pointer);
  return options;
}

Json SkinEncoderOptions::to_json() const {
  Json embedder;
  embedder["hidden_dim"] = hidden_dim();
  embedder["depth"] = jp_embedder_config.depth;
  embedder["jp_embed_attn"] = jp_embedder_config.jp_embed_attn;
  embedder["mlp_ratio"] = jp_embedder_config.mlp_ratio;
  Json json;
  json["skin_feat_channels"] = skin_feat_channels;
  json["skl_pos_embed_freq"] = skl_pos_embed_freq;
  json["jp_embedder_config"] = embedder;
  json["jp_embed_dim"] = jp_embed_dim;
  json["relative_pe"] = relative_pe;
  json["vert_feat_is_linear"] = vert_feat_is_linear;
  json["normalize_feat"] = normalize_feat;
  return json;
}

void SkinEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const std::string embedder = pointer + "/jp_embedder_config";
  check(!jp_embedder_config.jp_embed_attn || hidden_dim() % kJointEmbedderHeads == 0, file, embedder + "/hidden_dim",
        "with jp_embed_attn the hidden width must be a multiple of " + std::to_string(kJointEmbedderHeads) +
            ", found " + std::to_string(hidden_dim()));
  const auto narrowest = static_cast<double>(std::min(hidden_dim(), 2 * jp_embed_dim));
  check(std::floor(narrowest * jp_embedder_config.mlp_ratio) >= 1.0, file, embedder + "/mlp_ratio",
        "leaves no hidden channel");
}

SkinDecoderOptions SkinDecoderOptions::from_json(const Json& json, const std::string& file,
                                                 const std::string& pointer) {
  const SkinDecoderOptions options = read_decoder(ConfigReader(json, file, pointer));
  options.validate(file, pointer);
  return options;
}

Json SkinDecoderOptions::to_json() const {
  Json json;
  json["model_type"] = model_type;
  json["skin_feat_channels"] = skin_feat_channels;
  json["model_channels"] = model_channels;
  json["num_blocks"] = num_blocks;
  json["num_heads"] = num_heads;
  json["vert_cross_blocks_num"] = vert_cross_blocks_num;
  return json;
}

void SkinDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  if (model_type != "tree")
    throw NotSupportedError(file, pointer + "/model_type", "skin decoder '" + model_type + "'; use 'tree'");
  check(num_heads > 0 && model_channels % num_heads == 0, file, pointer + "/num_heads",
        std::to_string(num_heads) + " heads do not divide " + std::to_string(model_channels) + " channels");
  check(vert_cross_blocks_num <= num_blocks, file, pointer + "/vert_cross_blocks_num",
        "there are only " + std::to_string(num_blocks) + " blocks");
}

SkinAutoEncoderOptions SkinAutoEncoderOptions::from_json(const Json& json, const std::string& file,
                                                         const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  SkinAutoEncoderOptions options;
  options.encoder_config = read_encoder(reader.object("encoder_config"));
  options.decoder_config = read_decoder(reader.object("decoder_config"));
  options.use_fp16 = reader.boolean("use_fp16", options.use_fp16);
  reader.finish();
  options.validate(file, pointer);
  return options;
}

Json SkinAutoEncoderOptions::to_json() const {
  Json json;
  json["encoder_config"] = encoder_config.to_json();
  json["decoder_config"] = decoder_config.to_json();
  json["use_fp16"] = use_fp16;
  return json;
}

void SkinAutoEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  encoder_config.validate(file, pointer + "/encoder_config");
  decoder_config.validate(file, pointer + "/decoder_config");
  check(encoder_config.skin_feat_channels == decoder_config.skin_feat_channels, file,
        pointer + "/decoder_config/skin_feat_channels",
        "the decoder takes " + std::to_string(decoder_config.skin_feat_channels) + " channels, the encoder gives " +
            std::to_string(encoder_config.skin_feat_channels));
}

}  // namespace anigen::models
