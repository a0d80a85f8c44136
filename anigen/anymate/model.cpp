#include "anigen/anymate/model.h"

#include <algorithm>

#include "anigen/anymate/blocks.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/init.h"

namespace anigen::anymate {

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

namespace {

constexpr double kPadding = -3.0;  // outside of [-1, 1], where nothing is

std::string place_of(const AnymateSample& sample, const char* part) {
  return sample.name.empty() ? part : sample.name + "/" + part;
}

void require_part(bool fits, const AnymateSample& sample, const char* part, const std::string& problem) {
  if (!fits) throw InputError("", place_of(sample, part), problem);
}

void require_matrix(const Tensor& tensor, std::int64_t rows, std::int64_t columns, const AnymateSample& sample,
                    const char* part) {
  const bool fits = tensor.defined() && tensor.dim() == 2 && (rows < 0 || tensor.size(0) == rows) &&
                    (columns < 0 || tensor.size(1) == columns);
  require_part(fits, sample, part, "has shape " + nn::shape_text(tensor) + ", which does not fit");
}

// Rows [count, C] at the top of [rows, C].
Tensor padded(const Tensor& values, std::int64_t rows, const AnymateSample& sample, const char* part) {
  require_matrix(values, -1, -1, sample, part);
  require_part(values.size(0) >= 1 && values.size(0) <= rows, sample, part,
               "has " + std::to_string(values.size(0)) + " rows; from 1 to " + std::to_string(rows) + " are possible");
  return torch::constant_pad_nd(values.to(torch::kCPU, torch::kFloat32), {0, 0, 0, rows - values.size(0)}, kPadding);
}

void require_indices(const Tensor& indices, std::int64_t lowest, std::int64_t count, const AnymateSample& sample,
                     const char* part) {
  require_part(!indices.is_floating_point(), sample, part, "holds indices, which are integers");
  if (indices.numel() == 0) return;
  const bool fits = indices.min().item<std::int64_t>() >= lowest && indices.max().item<std::int64_t>() < count;
  require_part(fits, sample, part,
               "holds an index outside [" + std::to_string(lowest) + ", " + std::to_string(count) + ")");
}

// True when all samples have a part. @throws InputError when only some have
bool all_have(const std::vector<AnymateSample>& samples, Tensor AnymateSample::*part, const char* name) {
  const bool first = (samples.front().*part).defined();
  for (const AnymateSample& sample : samples) {
    require_part((sample.*part).defined() == first, sample, name,
                 "is there for some samples of a batch and not others");
  }
  return first;
}

// [B, most] with ones for the first counts[b] of each row.
Tensor prefix_mask(const std::vector<std::int64_t>& counts) {
  const std::int64_t most = *std::max_element(counts.begin(), counts.end());
  return torch::arange(most).unsqueeze(0) < torch::tensor(counts, torch::kInt64).unsqueeze(1);
}

Tensor one_hot_parents(const AnymateSample& sample, std::int64_t rows, std::int64_t columns) {
  const std::int64_t count = sample.joints.size(0);
  require_part(sample.conns.dim() == 1 && sample.conns.size(0) == count, sample, "conns", "is not one for each joint");
  require_indices(sample.conns, 0, count, sample, "conns");
  Tensor matrix = torch::zeros({rows, columns});
  const Tensor parents = sample.conns.to(torch::kCPU, torch::kInt64).unsqueeze(1);
  matrix.narrow(0, 0, count).scatter_(1, parents, 1.0);
  return matrix;
}

Tensor dense_skin(const AnymateSample& sample, std::int64_t columns) {
  require_matrix(sample.skins_index, -1, -1, sample, "skins_index");
  require_part(sample.skins_weight.defined() && sample.skins_weight.sizes() == sample.skins_index.sizes(), sample,
               "skins_weight", "has not the shape of skins_index");
  require_indices(sample.skins_index, -1, sample.bones.size(0), sample, "skins_index");
  Tensor index = sample.skins_index.to(torch::kCPU, torch::kInt64).clone();
  index.masked_fill_(index < 0, columns);  // a column more takes what holds nothing
  const Tensor weights = sample.skins_weight.to(torch::kCPU, torch::kFloat64);
  return torch::zeros({index.size(0), columns + 1}, torch::kFloat64).scatter_(1, index, weights).narrow(1, 0, columns);
}

// Stacks make(sample) of all. @throws InputError when shapes differ
template <typename Make>
Tensor stacked(const std::vector<AnymateSample>& samples, const char* part, const Make& make) {
  std::vector<Tensor> items;
  for (const AnymateSample& sample : samples) {
    items.push_back(make(sample));
    require_part(
        items.back().sizes() == items.front().sizes(), sample, part,
        "has shape " + nn::shape_text(items.back()) + ", the first sample's has " + nn::shape_text(items.front()));
  }
  return torch::stack(items);
}

// Members that both kinds of batches hold.
AnymateBatch positions_of(const std::vector<AnymateSample>& samples, const CollateOptions& options) {
  if (samples.empty()) throw InputError("", "samples", "there is nothing to collate");
  AnymateBatch batch;
  for (const AnymateSample& sample : samples) {
    require_matrix(sample.joints, -1, 3, sample, "joints");
    require_matrix(sample.bones, -1, 6, sample, "bones");
    batch.names.push_back(sample.name);
    batch.joints_num.push_back(sample.joints.size(0));
    batch.bones_num.push_back(sample.bones.size(0));
  }
  batch.joints = stacked(samples, "joints",
                         [&](const AnymateSample& s) { return padded(s.joints, options.max_joints, s, "joints"); });
  batch.bones =
      stacked(samples, "bones", [&](const AnymateSample& s) { return padded(s.bones, options.max_bones, s, "bones"); });
  if (all_have(samples, &AnymateSample::points_cloud, "pc")) {
    batch.points_cloud = stacked(samples, "pc", [](const AnymateSample& s) {
      require_matrix(s.points_cloud, -1, 6, s, "pc");
      return s.points_cloud.to(torch::kCPU, torch::kFloat32);
    });
  }
  if (all_have(samples, &AnymateSample::vox, "vox")) {
    for (const AnymateSample& sample : samples) {
      require_matrix(sample.vox, -1, 3, sample, "vox");
      batch.vox.push_back(sample.vox);
    }
  }
  return batch;
}

}  // namespace

AnymateBatch collate(const std::vector<AnymateSample>& samples, const CollateOptions& options) {
  AnymateBatch batch = positions_of(samples, options);
  batch.joints_mask = prefix_mask(batch.joints_num);
  batch.bones_mask = prefix_mask(batch.bones_num);
  if (all_have(samples, &AnymateSample::conns, "conns")) {
    const std::int64_t columns = batch.joints_mask.size(1);
    batch.conns = stacked(samples, "conns",
                          [&](const AnymateSample& s) { return one_hot_parents(s, options.max_joints, columns); });
  }
  if (all_have(samples, &AnymateSample::skins_index, "skins_index")) {
    const std::int64_t columns = batch.bones_mask.size(1);
    batch.skins = stacked(samples, "skins_index", [&](const AnymateSample& s) { return dense_skin(s, columns); });
  }
  return batch;
}

AnymateBatch collate_diffusion(const std::vector<AnymateSample>& samples, std::int64_t points,
                               const CollateOptions& options) {
  if (points <= 0) throw InputError("", "num_training_points", "must be positive");
  AnymateBatch batch = positions_of(samples, options);
  batch.joints_repeat = stacked(samples, "joints", [points](const AnymateSample& s) {
    const Tensor turn = torch::arange(points).remainder(s.joints.size(0));
    return s.joints.to(torch::kCPU, torch::kFloat32).index_select(0, turn);
  });
  return batch;
}

namespace {

void require_width(std::int64_t encoder, const ModelOptions& options) {
  const std::int64_t wanted = latent_width(options);
  if (encoder == wanted) return;
  throw InputError("", "width",
                   "'" + name_of(options.encoder) + "' gives latents of width " + std::to_string(encoder) + ", '" +
                       name_of(options.decoder) + "' takes " + std::to_string(wanted));
}

ConcatSkinningOptions concat_skinning(const ModelOptions& options) {
  ConcatSkinningOptions skinning = options.concat_skinning;
  skinning.separate = options.separate;
  return skinning;
}

template <typename Layer>
Layer with_defaults(Layer layer, nn::Init init) {
  if (init == nn::Init::kPublished) default_layers(*layer);
  return layer;
}

}  // namespace

std::shared_ptr<torch::nn::Module> make_decoder(const ModelOptions& options, nn::Init init) {
  const HeadOptions& head = options.head;
  switch (options.decoder) {
    case DecoderKind::kJointRegression:
      return std::make_shared<JointRegressionImpl>(head, options.num_joints, options.out_channels, init);
    case DecoderKind::kConcatDenoiser:
      return std::make_shared<ConcatDenoiserImpl>(options.concat_denoiser, init);
    case DecoderKind::kCrossDenoiser:
      return std::make_shared<CrossDenoiserImpl>(options.cross_denoiser, init);
    case DecoderKind::kImplicitVolume:
      return std::make_shared<ImplicitVolumeImpl>(head, init);
    case DecoderKind::kTriplaneVolume:
      return std::make_shared<TriplaneVolumeImpl>(options.triplane, init);
    case DecoderKind::kTokenConnectivity:
      return std::make_shared<TokenConnectivityImpl>(head, options.token_layers, options.head_token_length, init);
    case DecoderKind::kTwoBranchConnectivity:
      return std::make_shared<TwoBranchConnectivityImpl>(head, options.connectivity_layers, init);
    case DecoderKind::kConcatSkinning:
      return std::make_shared<ConcatSkinningImpl>(head, concat_skinning(options), init);
    case DecoderKind::kCrossSkinning:
      return std::make_shared<CrossSkinningImpl>(head, options.skinning_layers, options.separate, init);
  }
  throw InputError("", "decoder", "is none of the known ones");
}

AnymateModelImpl::AnymateModelImpl(const ModelOptions& options, nn::Init init) : options_(options) {
  make_encoder(init);
  decoder_ = register_module("decoder", make_decoder(options, init));
}

void AnymateModelImpl::make_encoder(nn::Init init) {
  const bool one_vector = options_.decoder == DecoderKind::kTriplaneVolume;
  switch (options_.encoder) {
    case EncoderKind::kBert: {
      ProjectionWidths widths = options_.projection;
      widths.in = options_.bert.trans_dim;
      require_width(widths.out, options_);
      bert_ = register_module("encoder", PointBert(options_.bert, init));
      if (one_vector) {
        pooled_projection_ = register_module("point_proj", PooledProjection(widths, bert_->token_count()));
        with_defaults(pooled_projection_, init);
      } else {
        token_projection_ = register_module("point_proj", TokenProjection(widths));
        with_defaults(token_projection_, init);
      }
      break;
    }
    case EncoderKind::kMichelangelo: {
      MichelangeloOptions michelangelo = options_.michelangelo;
      michelangelo.only_embed = one_vector;
      const std::int64_t width = michelangelo.width;
      require_width(width, options_);
      michelangelo_ = register_module("encoder", MichelangeloEncoder(michelangelo, init));
      if (options_.load_encoder && !one_vector) {
        loaded_projection_ = register_module("point_proj", ErfMlp(width, width, width, "0", "2"));
        with_defaults(loaded_projection_, init);
      }
      break;
    }
    case EncoderKind::kScratch: {
      const std::int64_t width = options_.scratch.width;
      require_width(width, options_);
      if (one_vector) throw InputError("", "encoder", "'transformer' has no single vector for 'triplane'");
      scratch_ = register_module("encoder", ScratchEncoder(options_.scratch, init));
      points_cloud_embed_ = register_module("points_cloud_embed", nn::Linear(width, width));
      with_defaults(points_cloud_embed_, init);
      break;
    }
  }
}

Tensor AnymateModelImpl::encode(const Tensor& points_cloud, const EncoderDraws& draws) {
  if (!bert_.is_empty()) {
    const Tensor tokens = bert_(points_cloud, draws.fps_start);
    return pooled_projection_.is_empty() ? token_projection_(tokens) : pooled_projection_(tokens);
  }
  if (!scratch_.is_empty()) return points_cloud_embed_(scratch_(points_cloud));
  const Tensor tokens = michelangelo_(points_cloud, draws.posterior_noise);
  return loaded_projection_.is_empty() ? tokens : loaded_projection_(tokens);
}

}  // namespace anigen::anymate
