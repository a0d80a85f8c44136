#include "anigen/models/anymate/model_options.h"

#include <algorithm>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::models::anymate {
namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostWidth = 16384, kMostTokens = 65536, kMostLayers = 256;

std::size_t index_of(const std::string& name, const std::vector<std::string>& names, const char* what) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  std::string known;
  for (const std::string& other : names) known += (known.empty() ? "" : ", ") + other;
  const std::string nearest = nearest_word(name, names);
  throw InputError(
      "", what,
      "there is no '" + name + "'; " + (nearest.empty() ? "known are " + known : "did you mean '" + nearest + "'?"));
}

void read_cross_denoiser(ConfigReader& reader, CrossDenoiserOptions& options) {
  options.num_z = reader.integer("num_z", options.num_z, 1, kMostTokens);
  options.num_latents = reader.integer("num_latents", options.num_latents, 1, kMostTokens);
  options.z_dim = reader.integer("z_dim", options.z_dim, 1, kMostWidth);
  options.x_dim = reader.integer("x_dim", options.x_dim, 1, kMostWidth);
  options.num_blocks = reader.integer("num_blocks", options.num_blocks, 1, kMostLayers);
  options.num_compute_layers = reader.integer("num_compute_layers", options.num_compute_layers, 0, kMostLayers);
  options.num_heads = reader.integer("num_heads", options.num_heads, 1, kMostWidth);
  options.mlp_ratio = reader.number("mlp_ratio", options.mlp_ratio, 0.0, 64.0);
  options.use_projection = reader.boolean("use_projection", options.use_projection);
}

}  // namespace

const std::vector<std::string>& encoder_names() {
  static const std::vector<std::string> names = {"bert", "miche", "transformer"};
  return names;
}

const std::vector<std::string>& decoder_names() {
  static const std::vector<std::string> names = {
      "transformer_latent",       "Pointe_Diffusion",   "Cross_Attention_Diffusion",
      "implicit_transformer",     "triplane",           "attendjoints_con_token",
      "attendjoints_con_combine", "attendjoints_multi", "attendjoints_combine"};
  return names;
}

EncoderKind encoder_kind(const std::string& name) {
  return static_cast<EncoderKind>(index_of(name, encoder_names(), "encoder"));
}

DecoderKind decoder_kind(const std::string& name) {
  return static_cast<DecoderKind>(index_of(name, decoder_names(), "decoder"));
}

const std::string& name_of(EncoderKind kind) { return encoder_names()[static_cast<std::size_t>(kind)]; }
const std::string& name_of(DecoderKind kind) { return decoder_names()[static_cast<std::size_t>(kind)]; }

ModelOptions ModelOptions::released(const std::string& encoder, const std::string& decoder) {
  ModelOptions options;
  options.encoder = encoder_kind(encoder);
  options.decoder = decoder_kind(decoder);
  return options;
}

ModelOptions ModelOptions::from_checkpoint_name(const std::string& file_name) {
  const std::size_t first = file_name.find('-');
  const std::size_t second = first == std::string::npos ? first : file_name.find('-', first + 1);
  if (second == std::string::npos) {
    throw InputError(file_name, "", "a released checkpoint is called <encoder>-<decoder>-….pth.tar");
  }
  return released(file_name.substr(0, first), file_name.substr(first + 1, second - first - 1));
}

ModelOptions ModelOptions::from_json(const Json& json, const std::string& file, const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  reader.require("encoder");
  reader.require("decoder");
  ModelOptions options;
  options.encoder = encoder_kind(reader.choice("encoder", "bert", encoder_names()));
  options.decoder = decoder_kind(reader.choice("decoder", "transformer_latent", decoder_names()));
  options.num_joints = reader.integer("num_joints", options.num_joints, 1, kMostTokens);
  options.out_channels = reader.integer("out_channels", options.out_channels, 3, 3);
  options.head.width = reader.integer("width", options.head.width, 1, kMostWidth);
  options.head.heads = reader.integer("heads", options.head.heads, 1, kMostWidth);
  options.head.init_scale = reader.number("init_scale", options.head.init_scale, 0.0, 1e3);
  options.head.qkv_bias = reader.boolean("qkv_bias", options.head.qkv_bias);
  options.separate = reader.boolean("separate", options.separate);
  options.load_encoder = reader.boolean("load_encoder", options.load_encoder);
  read_cross_denoiser(reader, options.cross_denoiser);
  options.concat_denoiser.layers = reader.integer("layers", options.concat_denoiser.layers, 1, kMostLayers);
  options.concat_denoiser.cond_drop_prob =
      reader.number("cond_drop_prob", options.concat_denoiser.cond_drop_prob, 0.0, 1.0);
  options.projection.out = options.head.width;
  for (const char* key : {"num_train_step", "num_training_points", "seed", "num_x", "n_ctx", "flash"}) reader.raw(key);
  reader.finish();
  return options;
}

}  // namespace anigen::models::anymate
