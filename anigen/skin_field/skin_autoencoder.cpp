#include "anigen/skin_field/skin_autoencoder.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"

namespace anigen::skin_field {

using torch::Tensor;

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMaxWidth = 16384;
constexpr std::int64_t kMaxBlocks = 256;
constexpr std::int64_t kMaxBands = 64;

void check_skin(const std::vector<Tensor>& skin, const nn::Ragged& joints) {
  if (static_cast<std::int64_t>(skin.size()) != joints.items()) {
    throw InputError(
        "", "", std::to_string(skin.size()) + " skin matrices for " + std::to_string(joints.items()) + " skeletons");
  }
  for (std::size_t i = 0; i < skin.size(); ++i) {
    if (skin[i].dim() == 2 && skin[i].size(1) == joints.lengths()[i]) continue;
    throw InputError("", "skeleton " + std::to_string(i),
                     "skin weights must have shape [V, " + std::to_string(joints.lengths()[i]) + "]");
  }
}

// Weighted sums over the joints of each asset: [ΣJ, C] → [ΣV, C].
Tensor weighted(const std::vector<Tensor>& skin, const Tensor& features, const nn::Ragged& joints) {
  const std::vector<Tensor> per_asset = joints.split(features);
  std::vector<Tensor> sums;
  for (std::size_t i = 0; i < skin.size(); ++i) sums.push_back(torch::mm(skin[i].to(features.options()), per_asset[i]));
  return sums.size() == 1 ? sums[0] : torch::cat(sums, 0);
}

nn::FreezableModel::Parts skin_autoencoder_parts(const SkinAutoEncoderOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.always_fp16 = {"skin_encoder.joint_embedder.blocks"};
  parts.other_fp16 = {"skin_decoder.blocks_vertex", "skin_decoder.blocks_skin"};
  parts.use_fp16 = options.use_fp16;
  return parts;
}

constexpr double kGeluSecondMoment = 0.425;  // of a standard normal

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// Xavier's variance is 2 / (in + out).
void set_variance(Tensor weight, double variance) {
  const auto sum = static_cast<double>(weight.size(0) + weight.size(1));
  weight.mul_(std::sqrt(variance * sum / 2.0));
}

double inputs(const Tensor& weight) { return static_cast<double>(weight.size(1)); }

}  // namespace

void JointEmbedderOptions::fields(ConfigFields& f) {
  f("hidden_dim", hidden_dim, {1, kMaxWidth});
  f("depth", depth, {0, kMaxBlocks});
  f("jp_embed_attn", jp_embed_attn);
  f("mlp_ratio", mlp_ratio, {0.0, 64.0});
}

void SkinEncoderOptions::fields(ConfigFields& f) {
  f("skin_feat_channels", skin_feat_channels, {1, kMaxWidth});
  f("skl_pos_embed_freq", skl_pos_embed_freq, {1, kMaxBands});
  if (!f.reads()) jp_embedder_config.hidden_dim = hidden_dim();
  f.object("jp_embedder_config", jp_embedder_config);
  f("jp_embed_dim", jp_embed_dim, {1, kMaxWidth});
  f("relative_pe", relative_pe);
  f("vert_feat_is_linear", vert_feat_is_linear);
  f("normalize_feat", normalize_feat);
}

void SkinEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(!jp_embedder_config.jp_embed_attn || hidden_dim() % kJointEmbedderHeads == 0, "jp_embedder_config/hidden_dim",
        "with jp_embed_attn the hidden width must be a multiple of " + std::to_string(kJointEmbedderHeads) +
            ", found " + std::to_string(hidden_dim()));
  const auto narrowest = static_cast<double>(std::min(hidden_dim(), 2 * jp_embed_dim));
  check(std::floor(narrowest * jp_embedder_config.mlp_ratio) >= 1.0, "jp_embedder_config/mlp_ratio",
        "leaves no hidden channel");
}

void SkinDecoderOptions::fields(ConfigFields& f) {
  f("model_type", model_type);
  f("skin_feat_channels", skin_feat_channels, {1, kMaxWidth});
  f("model_channels", model_channels, {1, kMaxWidth});
  f("num_blocks", num_blocks, {0, kMaxBlocks});
  f("num_heads", num_heads, {1, kMaxWidth});
  f("vert_cross_blocks_num", vert_cross_blocks_num, {0, kMaxBlocks});
}

void SkinDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  if (model_type != "tree")
    throw NotSupportedError(file, pointer + "/model_type", "skin decoder '" + model_type + "'; use 'tree'");
  const OptionCheck check{file, pointer};
  check.heads("num_heads", num_heads, model_channels);
  check(vert_cross_blocks_num <= num_blocks, "vert_cross_blocks_num",
        "there are only " + std::to_string(num_blocks) + " blocks");
}

void SkinAutoEncoderOptions::fields(ConfigFields& f) {
  f.object("encoder_config", encoder_config);
  f.object("decoder_config", decoder_config);
  f("use_fp16", use_fp16);
}

void SkinAutoEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  encoder_config.validate(file, pointer + "/encoder_config");
  decoder_config.validate(file, pointer + "/decoder_config");
  OptionCheck{file, pointer}(encoder_config.skin_feat_channels == decoder_config.skin_feat_channels,
                             "decoder_config/skin_feat_channels",
                             "the decoder takes " + std::to_string(decoder_config.skin_feat_channels) +
                                 " channels, the encoder gives " + std::to_string(encoder_config.skin_feat_channels));
}

JointEmbedderImpl::JointEmbedderImpl(std::int64_t in_channels, std::int64_t hidden_dim, std::int64_t out_channels,
                                     const JointEmbedderOptions& options) {
  in_layer_ = register_module("in_layer", nn::FeedForward(in_channels, hidden_dim, options.mlp_ratio));
  for (std::int64_t i = 0; i < options.depth; ++i) {
    if (options.jp_embed_attn) {
      attention_blocks_.emplace_back(hidden_dim, kJointEmbedderHeads, options.mlp_ratio);
    } else {
      plain_blocks_.emplace_back(hidden_dim, hidden_dim, options.mlp_ratio);
    }
  }
  register_module("blocks",
                  options.jp_embed_attn ? nn::module_list(attention_blocks_) : nn::module_list(plain_blocks_));
  out_layer_ = register_module("out_layer", nn::Linear(hidden_dim, out_channels));
}

Tensor JointEmbedderImpl::forward(const Tensor& pairs, const nn::Ragged& items) {
  const Tensor first = in_layer_->forward(pairs);
  return out_layer_->forward(run_blocks(first, items).to(nn::dtype_of(first)));
}

Tensor JointEmbedderImpl::run_blocks(const Tensor& first, const nn::Ragged& items) {
  if (!attention_blocks_.empty()) {
    Tensor h = first.to(attention_blocks_.front()->dtype());
    for (nn::TransformerBlock& block : attention_blocks_) h = block->forward(h, items);
    return h;
  }
  if (plain_blocks_.empty()) return first;
  // Each block adds the embedder's own input layer again, not the running value.
  const Tensor skip = first.to(plain_blocks_.front()->dtype());
  Tensor h = skip;
  for (nn::FeedForward& block : plain_blocks_) h = block->forward(h) + skip;
  return h;
}

SkinEncoderImpl::SkinEncoderImpl(const SkinEncoderOptions& options)
    : options_(options), fourier_(options.skl_pos_embed_freq) {
  const std::int64_t embed = options.jp_embed_dim, features = options.skin_feat_channels;
  root_embedding_ = register_parameter("root_embedding", torch::empty({1, embed}));
  pos_embedder_linear_ = register_module("pos_embedder_linear", nn::Linear(fourier_.width(3), embed));
  joint_embedder_ = register_module("joint_embedder",
                                    JointEmbedder(2 * embed, options.hidden_dim(), embed, options.jp_embedder_config));
  out_layer_vert_ = register_module("out_layer_vert", nn::FeedForward(embed, features));
  out_layer_joint_ = register_module("out_layer_joint", nn::FeedForward(embed, features));
}

void SkinEncoderImpl::initialize() {
  torch::nn::init::zeros_(root_embedding_);
  nn::xavier_uniform_linears(*this);
}

Tensor SkinEncoderImpl::embed_joints(const SkeletonBatch& skeletons) {
  const Tensor joints = skeletons.joints.to(root_embedding_.options());
  // e_j = J_j − J_π(j), a_j = Linear(PE(e_j)), h = embedder(a_j, a_π(j)).
  const Tensor positions = options_.relative_pe ? joints - joints.index_select(0, skeletons.anchor_rows) : joints;
  const Tensor own = pos_embedder_linear_->forward(fourier_(positions));
  const Tensor parent = torch::cat({own, root_embedding_}, 0).index_select(0, skeletons.parent_rows);
  const Tensor embedded = joint_embedder_->forward(torch::cat({own, parent}, 1), skeletons.items);
  return options_.normalize_feat ? nn::unit_length(embedded) : embedded;
}

Tensor SkinEncoderImpl::joint_features(const Tensor& embeddings) { return out_layer_joint_->forward(embeddings); }

Tensor SkinEncoderImpl::vertex_features(const Tensor& embeddings, const nn::Ragged& joints,
                                        const std::vector<Tensor>& skin) {
  check_skin(skin, joints);
  // f_V = W · head(h). The head is applied per joint where it may be: there are far fewer joints than points.
  if (options_.vert_feat_is_linear) return weighted(skin, out_layer_vert_->forward(embeddings), joints);
  return out_layer_vert_->forward(weighted(skin, embeddings, joints));
}

SkinDecoderImpl::SkinDecoderImpl(const SkinDecoderOptions& options) : options_(options) {
  const std::int64_t features = options.skin_feat_channels, channels = options.model_channels;
  root_features_ = register_parameter("root_features", torch::empty({1, features}));
  input_layer_vertex_ = register_module("input_layer_vertex", nn::Linear(features, channels));
  input_layer_skin_ = register_module("input_layer_skin", nn::Linear(2 * features, channels));
  torch::nn::ModuleList vertex_blocks, joint_blocks;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    if (i < options.vert_cross_blocks_num) {
      cross_blocks_.emplace_back(channels, options.num_heads);
      vertex_blocks->push_back(cross_blocks_.back());
    } else {
      vertex_blocks_.emplace_back(channels, channels);
      vertex_blocks->push_back(vertex_blocks_.back());
    }
    joint_blocks_.emplace_back(channels, options.num_heads);
    joint_blocks->push_back(joint_blocks_.back());
  }
  register_module("blocks_vertex", vertex_blocks);
  register_module("blocks_skin", joint_blocks);
  out_layer_vertex_ = register_module("out_layer_vertex", nn::Mlp(channels, 4 * channels, channels + 1));
  out_layer_skin_ = register_module("out_layer_skin", nn::Mlp(channels, 4 * channels, channels));
}

void SkinDecoderImpl::initialize() {
  torch::nn::init::zeros_(root_features_);
  nn::xavier_uniform_linears(*this);
}

SkinDecoderImpl::JointKeys SkinDecoderImpl::joint_keys(const Tensor& joint_features, const SkeletonBatch& skeletons) {
  const torch::Dtype dtype = nn::dtype_of(root_features_);
  const torch::Dtype block_dtype = joint_blocks_.empty() ? dtype : joint_blocks_.front()->dtype();
  const Tensor parents = torch::cat({joint_features, root_features_}, 0).index_select(0, skeletons.parent_rows);
  Tensor j = input_layer_skin_->forward(torch::cat({joint_features, parents}, 1)).to(block_dtype);
  JointKeys joints;
  joints.items = skeletons.items;
  for (std::size_t i = 0; i < joint_blocks_.size(); ++i) {
    // Vertices see the joints as they were before this round.
    if (i < cross_blocks_.size()) joints.rounds.push_back(j);
    j = joint_blocks_[i]->forward(j, skeletons.items);
  }
  joints.keys = skeletons.items.split(out_layer_skin_->forward(j.to(dtype)));
  return joints;
}

std::vector<Tensor> SkinDecoderImpl::logits(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const JointKeys& joints) {
  const torch::Dtype dtype = nn::dtype_of(root_features_);
  const torch::Dtype block_dtype = joint_blocks_.empty() ? dtype : joint_blocks_.front()->dtype();
  Tensor v = input_layer_vertex_->forward(vertex_features).to(block_dtype);
  for (std::size_t i = 0; i < joint_blocks_.size(); ++i) {
    v = i < cross_blocks_.size() ? cross_blocks_[i]->forward(v, vertices, joints.rounds[i], joints.items)
                                 : vertex_blocks_[i - cross_blocks_.size()]->forward(v);
  }
  const std::int64_t channels = options_.model_channels;
  const std::vector<Tensor> parts = out_layer_vertex_->forward(v.to(dtype)).split_with_sizes({channels, 1}, 1);
  // Logits τ_p ⟨q_p, j_i⟩ with the inverse temperature τ = ELU(s) + 2, above 1 (Eq. 5 divides by T = 1/τ).
  const std::vector<Tensor> queries = vertices.split(parts[0]);
  const std::vector<Tensor> temperatures = vertices.split(torch::elu(parts[1]) + 2.0);
  std::vector<Tensor> logits;
  for (std::size_t i = 0; i < joints.keys.size(); ++i)
    logits.push_back(torch::mm(queries[i], joints.keys[i].t()) * temperatures[i]);
  return logits;
}

std::vector<Tensor> SkinDecoderImpl::logits(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const Tensor& joint_features, const SkeletonBatch& skeletons) {
  return logits(vertex_features, vertices, joint_keys(joint_features, skeletons));
}

std::vector<Tensor> SkinDecoderImpl::decode(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const Tensor& joint_features, const SkeletonBatch& skeletons) {
  std::vector<Tensor> weights = logits(vertex_features, vertices, joint_features, skeletons);
  for (Tensor& item : weights) item = torch::softmax(item, -1);
  return weights;
}

std::vector<Tensor> SkinDecoderImpl::decode_log(const Tensor& vertex_features, const nn::Ragged& vertices,
                                                const Tensor& joint_features, const SkeletonBatch& skeletons) {
  std::vector<Tensor> weights = logits(vertex_features, vertices, joint_features, skeletons);
  for (Tensor& item : weights) item = torch::log_softmax(item, -1);
  return weights;
}

SkinAutoEncoderImpl::SkinAutoEncoderImpl(const SkinAutoEncoderOptions& options, nn::Init init)
    : nn::FreezableModel(skin_autoencoder_parts(options)), options_(options) {
  options.validate();
  encoder_ = register_module("skin_encoder", SkinEncoder(options.encoder_config));
  decoder_ = register_module("skin_decoder", SkinDecoder(options.decoder_config));
  if (init == nn::Init::kNone) return;
  encoder_->initialize();
  decoder_->initialize();
}

SkinAutoEncoderImpl::Output SkinAutoEncoderImpl::forward(const std::vector<Tensor>& joints,
                                                         const std::vector<Tensor>& parents,
                                                         const std::vector<Tensor>& skin) {
  const SkeletonBatch skeletons = SkeletonBatch::from_lists(joints, parents);
  const JointCode code = encode_joints(skeletons);
  const Tensor vertex_features = encode_vertices(code, skeletons, skin);
  const nn::Ragged vertices = rows_of(skin);
  Output output;
  output.joint_embeds = skeletons.items.split(code.features);
  output.vert_embeds = vertices.split(vertex_features);
  output.skin = decode(vertex_features, vertices, code.features, skeletons);
  return output;
}

std::vector<Tensor> SkinAutoEncoderImpl::reconstruct_log(const SkeletonBatch& skeletons,
                                                         const std::vector<Tensor>& skin) {
  const JointCode code = encode_joints(skeletons);
  return decoder_->decode_log(encode_vertices(code, skeletons, skin), rows_of(skin), code.features, skeletons);
}

SkinAutoEncoderImpl::JointCode SkinAutoEncoderImpl::encode_joints(const SkeletonBatch& skeletons) {
  JointCode code;
  code.embeddings = encoder_->embed_joints(skeletons);
  code.features = encoder_->joint_features(code.embeddings);
  return code;
}

Tensor SkinAutoEncoderImpl::encode_vertices(const JointCode& joints, const SkeletonBatch& skeletons,
                                            const std::vector<Tensor>& skin) {
  return encoder_->vertex_features(joints.embeddings, skeletons.items, skin);
}

std::vector<Tensor> SkinAutoEncoderImpl::decode(const Tensor& vertex_features, const nn::Ragged& vertices,
                                                const Tensor& joint_features, const SkeletonBatch& skeletons) {
  return decoder_->decode(vertex_features, vertices, joint_features, skeletons);
}

nn::Ragged rows_of(const std::vector<Tensor>& matrices) {
  std::vector<std::int64_t> rows;
  for (const Tensor& matrix : matrices) rows.push_back(matrix.size(0));
  return nn::Ragged(rows);
}

void rescale_to_unit_gain(SkinAutoEncoder& model) {
  const torch::NoGradGuard no_grad;
  const auto embed = static_cast<double>(model->options().encoder_config.jp_embed_dim);
  const auto channels = static_cast<double>(model->options().decoder_config.model_channels);
  for (const auto& part : model->named_modules("", /*include_self=*/false)) {
    if (part.value()->as<nn::MlpImpl>() != nullptr) {
      const auto parameters = part.value()->named_parameters();
      const Tensor &first = parameters["0.weight"], &second = parameters["2.weight"];
      const bool behind_embedding =
          ends_with(part.key(), "out_layer_vert.mlp") || ends_with(part.key(), "out_layer_joint.mlp");
      const bool makes_logits = ends_with(part.key(), "out_layer_vertex") || ends_with(part.key(), "out_layer_skin");
      const bool unit_length = behind_embedding && model->options().encoder_config.normalize_feat;
      set_variance(first, (unit_length ? embed : 1.0) / inputs(first));
      set_variance(second, (makes_logits ? 1.0 / std::sqrt(channels) : 1.0) / (kGeluSecondMoment * inputs(second)));
    } else if (ends_with(part.key(), "input_layer_vertex") || ends_with(part.key(), "input_layer_skin")) {
      const Tensor weight = part.value()->named_parameters()["weight"];
      set_variance(weight, 1.0 / inputs(weight));
    }
  }
}

}  // namespace anigen::skin_field
