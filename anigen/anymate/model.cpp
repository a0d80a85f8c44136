#include "anigen/anymate/model.h"

#include <algorithm>

#include "anigen/anymate/blocks.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "anigen/nn/init.h"

namespace anigen::anymate {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostWidth = 16384, kMostTokens = 65536, kMostLayers = 256;

std::size_t index_of(const std::string& name, const std::vector<std::string>& names, const char* what) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  throw InputError("", what, "there is no '" + name + "'; " + suggestion(name, names));
}

// Words of a config for the values of an enum, in its order.
template <typename Kind>
std::vector<std::pair<std::string, Kind>> words_for(const std::vector<std::string>& names) {
  std::vector<std::pair<std::string, Kind>> words;
  for (std::size_t i = 0; i < names.size(); ++i) words.emplace_back(names[i], static_cast<Kind>(i));
  return words;
}

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

// The width of the latents that the decoder takes.
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

// @throws InputError naming the nearest known name
EncoderKind encoder_kind(const std::string& name) {
  return static_cast<EncoderKind>(index_of(name, encoder_names(), "encoder"));
}

DecoderKind decoder_kind(const std::string& name) {
  return static_cast<DecoderKind>(index_of(name, decoder_names(), "decoder"));
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

const std::string& name_of(EncoderKind kind) { return encoder_names()[static_cast<std::size_t>(kind)]; }
const std::string& name_of(DecoderKind kind) { return decoder_names()[static_cast<std::size_t>(kind)]; }

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
  if (second == std::string::npos)
    throw InputError(file_name, "", "a released checkpoint is called <encoder>-<decoder>-….pth.tar");
  return released(file_name.substr(0, first), file_name.substr(first + 1, second - first - 1));
}

void ModelOptions::fields(ConfigFields& f) {
  const FieldRange<std::int64_t> width{1, kMostWidth}, tokens{1, kMostTokens}, count{1, kMostLayers};
  const FieldRange<std::int64_t> any_count{0, kMostLayers};
  f("encoder", encoder, words_for<EncoderKind>(encoder_names()), kRequired);
  f("decoder", decoder, words_for<DecoderKind>(decoder_names()), kRequired);
  f("num_joints", num_joints, tokens);
  f("out_channels", out_channels, {3, 3});
  f("width", head.width, width);
  f("heads", head.heads, width);
  f("init_scale", head.init_scale, {0.0, 1e3});
  f("qkv_bias", head.qkv_bias);
  f("separate", separate);
  f("load_encoder", load_encoder);
  f("num_z", cross_denoiser.num_z, tokens);
  f("num_latents", cross_denoiser.num_latents, tokens);
  f("z_dim", cross_denoiser.z_dim, width);
  f("x_dim", cross_denoiser.x_dim, width);
  f("num_blocks", cross_denoiser.num_blocks, count);
  f("num_compute_layers", cross_denoiser.num_compute_layers, any_count);
  f("num_heads", cross_denoiser.num_heads, width);
  f("mlp_ratio", cross_denoiser.mlp_ratio, {0.0, 64.0});
  f("use_projection", cross_denoiser.use_projection);
  f("layers", concat_denoiser.layers, count);
  f("cond_drop_prob", concat_denoiser.cond_drop_prob, {0.0, 1.0});
  // Sizes that released configs have no words for: ours, for small models.
  f.object("bert", [&](ConfigFields& g) {
    g("trans_dim", bert.trans_dim, width);
    g("depth", bert.depth, count);
    g("num_heads", bert.num_heads, width);
    g("group_size", bert.group_size, tokens);
    g("num_group", bert.num_group, tokens);
    g("encoder_dims", bert.encoder_dims, width);
    g("drop_path_rate", bert.drop_path_rate, {0.0, 0.99});
    g("projection_1", projection.hidden_1, width);
    g("projection_2", projection.hidden_2, width);
  });
  f.object("michelangelo", [&](ConfigFields& g) {
    g("num_latents", michelangelo.num_latents, tokens);
    g("embed_dim", michelangelo.embed_dim, width);
    g("width", michelangelo.width, width);
    g("heads", michelangelo.heads, width);
    g("num_encoder_layers", michelangelo.num_encoder_layers, any_count);
    g("num_decoder_layers", michelangelo.num_decoder_layers, any_count);
  });
  f.object("scratch", [&](ConfigFields& g) {
    g("num_latents", scratch.num_latents, tokens);
    g("width", scratch.width, width);
    g("heads", scratch.heads, width);
    g("num_encoder_layers", scratch.num_encoder_layers, any_count);
  });
  f("connectivity_layers", connectivity_layers, count);
  f("token_layers", token_layers, count);
  f("head_token_length", head_token_length, width);
  f("children", children, {"rows", "columns"});
  f("skinning_layers", skinning_layers, count);
  f.object("concat_denoiser", [&](ConfigFields& g) {
    g("width", concat_denoiser.width, width);
    g("heads", concat_denoiser.heads, width);
  });
  f.object("concat_skinning", [&](ConfigFields& g) {
    g("layers", concat_skinning.layers, count);
    g("concat_num", concat_skinning.concat_num, tokens);
  });
  f.object("triplane", [&](ConfigFields& g) {
    g("z_dim", triplane.z_dim, width);
    g("w_dim", triplane.w_dim, width);
    g("img_resolution", triplane.img_resolution, {4, 4096});
    g("channel_base", triplane.channel_base, {1, 1 << 20});
    g("channel_max", triplane.channel_max, width);
  });
  for (const char* key : {"num_train_step", "num_training_points", "seed", "num_x", "n_ctx", "flash"}) f.unused(key);
  if (f.reads()) projection.out = latent_width(*this);
}

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

template <typename Connectivity>
std::shared_ptr<torch::nn::Module> with_roles(std::shared_ptr<Connectivity> decoder, const ModelOptions& options) {
  decoder->columns_are_children(options.children == "columns");
  return decoder;
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
      return with_roles(
          std::make_shared<TokenConnectivityImpl>(head, options.token_layers, options.head_token_length, init),
          options);
    case DecoderKind::kTwoBranchConnectivity:
      return with_roles(std::make_shared<TwoBranchConnectivityImpl>(head, options.connectivity_layers, init), options);
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
        pooled_projection_ = with_defaults(PooledProjection(widths, bert_->token_count()), init);
        register_module("point_proj", pooled_projection_);
      } else {
        token_projection_ = register_module("point_proj", with_defaults(TokenProjection(widths), init));
      }
      break;
    }
    case EncoderKind::kMichelangelo: {
      MichelangeloOptions michelangelo = options_.michelangelo;
      michelangelo.only_embed = one_vector;
      const std::int64_t width = michelangelo.width;
      require_width(width, options_);
      michelangelo_ = register_module("encoder", MichelangeloEncoder(michelangelo, init));
      if (options_.load_encoder && !one_vector)
        loaded_projection_ = register_module("point_proj", with_defaults(ErfMlp(width, width, width, "0", "2"), init));
      break;
    }
    case EncoderKind::kScratch: {
      const std::int64_t width = options_.scratch.width;
      require_width(width, options_);
      if (one_vector) throw InputError("", "encoder", "'transformer' has no single vector for 'triplane'");
      scratch_ = register_module("encoder", ScratchEncoder(options_.scratch, init));
      points_cloud_embed_ = register_module("points_cloud_embed", with_defaults(nn::Linear(width, width), init));
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
