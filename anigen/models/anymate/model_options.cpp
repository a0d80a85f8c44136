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

// Sizes that released configs have no words for: ours, for small models.
void read_encoder_sizes(ConfigReader& reader, ModelOptions& options) {
  ConfigReader bert = reader.object("bert");
  options.bert.trans_dim = bert.integer("trans_dim", options.bert.trans_dim, 1, kMostWidth);
  options.bert.depth = bert.integer("depth", options.bert.depth, 1, kMostLayers);
  options.bert.num_heads = bert.integer("num_heads", options.bert.num_heads, 1, kMostWidth);
  options.bert.group_size = bert.integer("group_size", options.bert.group_size, 1, kMostTokens);
  options.bert.num_group = bert.integer("num_group", options.bert.num_group, 1, kMostTokens);
  options.bert.encoder_dims = bert.integer("encoder_dims", options.bert.encoder_dims, 1, kMostWidth);
  options.bert.drop_path_rate = bert.number("drop_path_rate", options.bert.drop_path_rate, 0.0, 0.99);
  options.projection.hidden_1 = bert.integer("projection_1", options.projection.hidden_1, 1, kMostWidth);
  options.projection.hidden_2 = bert.integer("projection_2", options.projection.hidden_2, 1, kMostWidth);
  bert.finish();
  ConfigReader miche = reader.object("michelangelo");
  MichelangeloOptions& michelangelo = options.michelangelo;
  michelangelo.num_latents = miche.integer("num_latents", michelangelo.num_latents, 1, kMostTokens);
  michelangelo.embed_dim = miche.integer("embed_dim", michelangelo.embed_dim, 1, kMostWidth);
  michelangelo.width = miche.integer("width", michelangelo.width, 1, kMostWidth);
  michelangelo.heads = miche.integer("heads", michelangelo.heads, 1, kMostWidth);
  michelangelo.num_encoder_layers =
      miche.integer("num_encoder_layers", michelangelo.num_encoder_layers, 0, kMostLayers);
  michelangelo.num_decoder_layers =
      miche.integer("num_decoder_layers", michelangelo.num_decoder_layers, 0, kMostLayers);
  miche.finish();
  ConfigReader scratch = reader.object("scratch");
  options.scratch.num_latents = scratch.integer("num_latents", options.scratch.num_latents, 1, kMostTokens);
  options.scratch.width = scratch.integer("width", options.scratch.width, 1, kMostWidth);
  options.scratch.heads = scratch.integer("heads", options.scratch.heads, 1, kMostWidth);
  options.scratch.num_encoder_layers =
      scratch.integer("num_encoder_layers", options.scratch.num_encoder_layers, 0, kMostLayers);
  scratch.finish();
}

void read_decoder_sizes(ConfigReader& reader, ModelOptions& options) {
  options.connectivity_layers = reader.integer("connectivity_layers", options.connectivity_layers, 1, kMostLayers);
  options.token_layers = reader.integer("token_layers", options.token_layers, 1, kMostLayers);
  options.head_token_length = reader.integer("head_token_length", options.head_token_length, 1, kMostWidth);
  options.skinning_layers = reader.integer("skinning_layers", options.skinning_layers, 1, kMostLayers);
  ConfigReader concat = reader.object("concat_denoiser");
  options.concat_denoiser.width = concat.integer("width", options.concat_denoiser.width, 1, kMostWidth);
  options.concat_denoiser.heads = concat.integer("heads", options.concat_denoiser.heads, 1, kMostWidth);
  concat.finish();
  ConfigReader skinning = reader.object("concat_skinning");
  options.concat_skinning.layers = skinning.integer("layers", options.concat_skinning.layers, 1, kMostLayers);
  options.concat_skinning.concat_num =
      skinning.integer("concat_num", options.concat_skinning.concat_num, 1, kMostTokens);
  skinning.finish();
  ConfigReader triplane = reader.object("triplane");
  options.triplane.z_dim = triplane.integer("z_dim", options.triplane.z_dim, 1, kMostWidth);
  options.triplane.w_dim = triplane.integer("w_dim", options.triplane.w_dim, 1, kMostWidth);
  options.triplane.img_resolution = triplane.integer("img_resolution", options.triplane.img_resolution, 4, 4096);
  options.triplane.channel_base = triplane.integer("channel_base", options.triplane.channel_base, 1, 1 << 20);
  options.triplane.channel_max = triplane.integer("channel_max", options.triplane.channel_max, 1, kMostWidth);
  triplane.finish();
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

std::int64_t latent_width(const ModelOptions& options) {
  switch (options.decoder) {
    case DecoderKind::kConcatDenoiser:
      return options.concat_denoiser.width;
    case DecoderKind::kCrossDenoiser:
      return options.cross_denoiser.z_dim;
    case DecoderKind::kTriplaneVolume:
      return options.triplane.z_dim;
    default:
      return options.head.width;
  }
}

Task task_of(DecoderKind kind) {
  switch (kind) {
    case DecoderKind::kTokenConnectivity:
    case DecoderKind::kTwoBranchConnectivity:
      return Task::kConnectivity;
    case DecoderKind::kConcatSkinning:
    case DecoderKind::kCrossSkinning:
      return Task::kSkinning;
    case DecoderKind::kConcatDenoiser:
    case DecoderKind::kCrossDenoiser:
      return Task::kDenoisedJoints;
    case DecoderKind::kImplicitVolume:
    case DecoderKind::kTriplaneVolume:
      return Task::kJointVolume;
    case DecoderKind::kJointRegression:
      return Task::kJointRegression;
  }
  throw InputError("", "decoder", "is none of the known ones");
}

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
  read_encoder_sizes(reader, options);
  read_decoder_sizes(reader, options);
  options.projection.out = latent_width(options);
  for (const char* key : {"num_train_step", "num_training_points", "seed", "num_x", "n_ctx", "flash"}) reader.raw(key);
  reader.finish();
  return options;
}

}  // namespace anigen::models::anymate
