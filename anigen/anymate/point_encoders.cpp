#include "anigen/anymate/point_encoders.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>

#include "anigen/anymate/denoisers.h"
#include "anigen/nn/gelu_erf.h"
#include "anigen/nn/linear.h"

namespace anigen::anymate {

namespace {

constexpr float kFarther = 1e10F;  // than any point, before the first choice

void require_count(std::int64_t count, std::int64_t points, const char* what) {
  require(count > 0 && count <= points, what,
          std::to_string(count) + " of " + std::to_string(points) + " points were asked for");
}

// Coordinates apart, so that the loop over points is vectorised.
void choose_farthest(const float* points, std::int64_t n, std::int64_t start, std::int64_t count,
                     std::int64_t* chosen) {
  const auto size = static_cast<std::size_t>(n);
  std::vector<float> x(size), y(size), z(size), distance(size, kFarther);
  for (std::size_t i = 0; i < size; ++i) {
    x[i] = points[3 * i];
    y[i] = points[3 * i + 1];
    z[i] = points[3 * i + 2];
  }
  auto last = static_cast<std::size_t>(start);
  for (std::int64_t choice = 0; choice < count; ++choice) {
    chosen[choice] = static_cast<std::int64_t>(last);
    const float at_x = x[last], at_y = y[last], at_z = z[last];
    for (std::size_t i = 0; i < size; ++i) {
      const float dx = x[i] - at_x, dy = y[i] - at_y, dz = z[i] - at_z;
      distance[i] = std::min(distance[i], dx * dx + dy * dy + dz * dz);
    }
    last = static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
  }
}

constexpr std::int64_t kFirstWidth = 128, kLocalWidth = 256, kJoinedWidth = 2 * kLocalWidth;

// The norm sees rows, which is the same as channels first.
Tensor normalised(torch::nn::BatchNorm1d& norm, const Tensor& x) { return norm(x.flatten(0, -2)).view(x.sizes()); }

// Not amax, which shares the gradient among equal values.
Tensor group_maximum(const Tensor& x) { return std::get<0>(x.max(-2)); }

constexpr std::int64_t kPositionHidden = 128;

constexpr double kLeastLogvar = -30.0, kMostLogvar = 20.0;
constexpr double kQueryDeviation = 0.02;

PerceiverOptions perceiver_options(const MichelangeloOptions& options) {
  PerceiverOptions perceiver;
  perceiver.num_latents = options.num_latents + 1;
  perceiver.features = options.point_feats + kHarmonics;
  perceiver.width = options.width;
  perceiver.heads = options.heads;
  perceiver.layers = options.num_encoder_layers;
  perceiver.num_freqs = options.num_freqs;
  perceiver.include_pi = options.include_pi;
  perceiver.qkv_bias = options.qkv_bias;
  perceiver.ln_post = options.use_ln_post;
  return perceiver;
}

constexpr double kScratchQueryDeviation = 0.02;

// Rows of each item.
Tensor rows_of_items(const Tensor& points, const Tensor& rows) {
  const Tensor flat = rows.flatten(1);
  std::vector<std::int64_t> shape = rows.sizes().vec();
  shape.push_back(points.size(-1));
  return points.gather(1, flat.unsqueeze(-1).expand({-1, -1, points.size(-1)})).view(shape);
}

}  // namespace

Tensor farthest_points(const Tensor& points, std::int64_t count, const Tensor& start) {
  require_shape(points, {-1, -1, 3}, "points");
  require_shape(start, {points.size(0)}, "start");
  const std::int64_t items = points.size(0), n = points.size(1);
  require_count(count, n, "num_group");
  const Tensor cpu = points.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor first = start.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* begin = first.data_ptr<std::int64_t>();
  require(std::all_of(begin, begin + items, [n](std::int64_t row) { return row >= 0 && row < n; }), "start",
          "is not an index of one of " + std::to_string(n) + " points");
  Tensor chosen = torch::empty({items, count}, torch::kInt64);
  const float* values = cpu.data_ptr<float>();
  auto* out = chosen.data_ptr<std::int64_t>();
  at::parallel_for(0, items, 1, [&](std::int64_t low, std::int64_t high) {
    for (std::int64_t b = low; b < high; ++b) choose_farthest(values + 3 * n * b, n, begin[b], count, out + count * b);
  });
  return chosen.to(points.device());
}

Tensor nearest_points(const Tensor& points, const Tensor& centers, std::int64_t count) {
  require_shape(points, {-1, -1, 3}, "points");
  require_shape(centers, {points.size(0), -1, 3}, "centers");
  require_count(count, points.size(1), "group_size");
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> items;
  for (std::int64_t b = 0; b < points.size(0); ++b) {
    const Tensor all = points[b], center = centers[b];
    Tensor squared = torch::matmul(center, all.t()).mul_(-2.0);
    squared.add_(center.square().sum(-1).unsqueeze(1)).add_(all.square().sum(-1).unsqueeze(0));
    items.push_back(std::get<1>(squared.topk(count, -1, /*largest=*/false, /*sorted=*/false)));
  }
  return torch::stack(items, 0);
}

PointwiseConvImpl::PointwiseConvImpl(std::int64_t in, std::int64_t out) {
  weight = register_parameter("weight", torch::empty({out, in, 1}));
  bias = register_parameter("bias", torch::empty({out}));
}

Tensor PointwiseConvImpl::forward(const Tensor& x) { return nn::linear(x, weight.squeeze(-1), bias); }

MiniPointNetImpl::MiniPointNetImpl(std::int64_t in, std::int64_t out) {
  const auto first = register_module("first_conv", std::make_shared<torch::nn::Module>());
  conv1_ = first->register_module("0", PointwiseConv(in, kFirstWidth));
  norm1_ = first->register_module("1", torch::nn::BatchNorm1d(kFirstWidth));
  conv2_ = first->register_module("3", PointwiseConv(kFirstWidth, kLocalWidth));
  const auto second = register_module("second_conv", std::make_shared<torch::nn::Module>());
  conv3_ = second->register_module("0", PointwiseConv(kJoinedWidth, kJoinedWidth));
  norm2_ = second->register_module("1", torch::nn::BatchNorm1d(kJoinedWidth));
  conv4_ = second->register_module("3", PointwiseConv(kJoinedWidth, out));
}

// The map of [whole group, point], whose first half is the same for all points of a group.
Tensor MiniPointNetImpl::second_layer(const Tensor& each, const Tensor& whole) {
  const Tensor weight = conv3_->weight.squeeze(-1);
  const Tensor of_group = nn::linear(whole, weight.slice(1, 0, kLocalWidth), conv3_->bias);
  return nn::linear(each, weight.slice(1, kLocalWidth)) + of_group.unsqueeze(-2);
}

Tensor MiniPointNetImpl::forward(const Tensor& groups) {
  const Tensor local = conv2_(torch::relu(normalised(norm1_, conv1_(groups))));
  const Tensor joined = second_layer(local, group_maximum(local));
  return group_maximum(conv4_(torch::relu(normalised(norm2_, joined))));
}

PointBertImpl::PointBertImpl(const PointBertOptions& options, nn::Init init) : options_(options) {
  require(options.point_dims >= 3, "point_dims", "a point has at least its position");
  require(options.depth >= 0, "depth", "must not be negative");
  const std::int64_t width = options.trans_dim;
  cls_token_ = register_parameter("cls_token", torch::empty({1, 1, width}));
  cls_pos_ = register_parameter("cls_pos", torch::empty({1, 1, width}));
  encoder_ = register_module("encoder", MiniPointNet(options.point_dims, options.encoder_dims));
  reduce_dim_ = register_module("reduce_dim", nn::Linear(options.encoder_dims, width));
  pos_embed_ = register_module("pos_embed", ErfMlp(3, kPositionHidden, width, "0", "2"));
  const auto blocks = register_module("blocks", std::make_shared<torch::nn::Module>());
  for (std::int64_t i = 0; i < options.depth; ++i) {
    const double share = options.depth > 1 ? static_cast<double>(i) / static_cast<double>(options.depth - 1) : 0.0;
    blocks_.emplace_back(width, options.num_heads, options.drop_path_rate * share);
  }
  blocks->register_module("blocks", nn::module_list(blocks_));
  norm_ = register_module("norm", nn::AffineLayerNorm(width, kNormEps));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  torch::nn::init::zeros_(cls_token_);
  torch::nn::init::normal_(cls_pos_);
}

PointGroups PointBertImpl::grouped(const Tensor& points, const Tensor& start) const {
  require(points.defined() && points.dim() == 3 && points.size(-1) >= 3, "points_cloud", "must be [B, N, 3 or more]");
  const std::int64_t items = points.size(0), n = points.size(1);
  // The encoder was trained on clouds in a ball of half the size, with colours, which Anymate's clouds do not have.
  const Tensor positions = points.slice(-1, 0, 3) / 2.0;
  Tensor first = start;
  if (!first.defined()) {
    first = is_training() ? torch::randint(n, {items}, torch::kInt64) : torch::zeros({items}, torch::kInt64);
  }
  PointGroups groups;
  groups.centers = rows_of_items(positions, farthest_points(positions, options_.num_group, first));
  groups.rows = nearest_points(positions, groups.centers, options_.group_size);
  const Tensor offsets = rows_of_items(positions, groups.rows) - groups.centers.unsqueeze(2);
  groups.points = torch::constant_pad_nd(offsets, {0, options_.point_dims - 3});
  return groups;
}

Tensor PointBertImpl::tokens(const PointGroups& groups, const Tensor& features) {
  const std::int64_t items = features.size(0);
  Tensor x = torch::cat({cls_token_.expand({items, -1, -1}), reduce_dim_(features)}, 1);
  const Tensor positions = torch::cat({cls_pos_.expand({items, -1, -1}), pos_embed_(groups.centers)}, 1);
  for (VitBlock& block : blocks_) x = block->forward(x + positions);  // positions again before every block
  return norm_(x);
}

Tensor PointBertImpl::forward(const Tensor& points, const Tensor& start) {
  const PointGroups groups = grouped(points, start);
  return tokens(groups, group_features(groups));
}

PerceiverEncoderImpl::PerceiverEncoderImpl(const PerceiverOptions& options) : options_(options) {
  require(options.num_latents > 0, "num_latents", "must be positive");
  const std::int64_t channels = fourier_width(options.num_freqs) + options.features;
  query = register_parameter("query", torch::empty({options.num_latents, options.width}));
  input_proj_ = register_module("input_proj", nn::Linear(channels, options.width));
  cross_attn_ = register_module("cross_attn", ResidualCrossAttention(options.width, options.heads, options.qkv_bias));
  self_attn_ =
      register_module("self_attn", ResidualStack(options.layers, options.width, options.heads, options.qkv_bias));
  if (options.ln_post) ln_post_ = register_module("ln_post", nn::AffineLayerNorm(options.width, kNormEps));
}

Tensor PerceiverEncoderImpl::forward(const Tensor& positions, const Tensor& features) {
  const Tensor waves = fourier_features(positions, options_.num_freqs, options_.include_pi);
  const Tensor points = input_proj_(torch::cat({waves, features}, -1));
  const Tensor queries = query.unsqueeze(0).expand({positions.size(0), -1, -1});
  const Tensor tokens = self_attn_(cross_attn_(queries, points));
  return ln_post_.is_empty() ? tokens : ln_post_(tokens);
}

MichelangeloEncoderImpl::MichelangeloEncoderImpl(const MichelangeloOptions& options, nn::Init init)
    : options_(options) {
  require(options.point_feats == 3, "point_feats", "must be 3, the normal");
  const std::int64_t width = options.width;
  shape_projection_ = register_parameter("shape_projection", torch::empty({width, width}));
  encoder_ = register_module("encoder", PerceiverEncoder(perceiver_options(options)));
  if (!options.only_embed) {
    pre_kl_ = register_module("pre_kl", nn::Linear(width, 2 * options.embed_dim));
    post_kl_ = register_module("post_kl", nn::Linear(options.embed_dim, width));
    transformer_ = register_module("transformer",
                                   ResidualStack(options.num_decoder_layers, width, options.heads, options.qkv_bias));
  }
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale / std::sqrt(static_cast<double>(width)));
  torch::nn::init::normal_(encoder_->query, 0.0, kQueryDeviation);
  torch::nn::init::normal_(shape_projection_, 0.0, 1.0 / std::sqrt(static_cast<double>(width)));
}

Tensor MichelangeloEncoderImpl::perceived(const Tensor& points) {
  require_shape(points, {-1, -1, 6}, "points_cloud");
  const Tensor positions = points.slice(-1, 0, 3), normals = points.slice(-1, 3, 6);
  return encoder_(positions, torch::cat({normals, spherical_harmonics(normals)}, -1));
}

Tensor MichelangeloEncoderImpl::shape_embed(const Tensor& points) {
  return torch::matmul(perceived(points).select(1, 0), shape_projection_);
}

MichelangeloCode MichelangeloEncoderImpl::encode(const Tensor& points, const Tensor& noise) {
  require(!options_.only_embed, "only_embed", "an encoder of one embedding has no latents");
  const Tensor tokens = perceived(points);
  MichelangeloCode code;
  code.shape_embed = torch::matmul(tokens.select(1, 0), shape_projection_);
  code.shape_latents = tokens.slice(1, 1);
  const std::vector<Tensor> moments = pre_kl_(code.shape_latents).chunk(2, -1);
  code.kl_mean = moments[0];
  code.kl_logvar = moments[1].clamp(kLeastLogvar, kMostLogvar);
  Tensor sample = code.kl_mean;
  if (noise.defined() || is_training()) {
    if (noise.defined()) require_shape(noise, sample.sizes().vec(), "noise");
    sample = sample + (0.5 * code.kl_logvar).exp() * (noise.defined() ? noise : torch::randn_like(sample));
  }
  code.latents = transformer_(post_kl_(sample));
  return code;
}

Tensor MichelangeloEncoderImpl::forward(const Tensor& points, const Tensor& noise) {
  return options_.only_embed ? shape_embed(points) : encode(points, noise).tokens();
}

ScratchEncoderImpl::ScratchEncoderImpl(const ScratchEncoderOptions& options, nn::Init init) {
  PerceiverOptions perceiver;
  perceiver.num_latents = options.num_latents;
  perceiver.width = options.width;
  perceiver.heads = options.heads;
  perceiver.layers = options.num_encoder_layers;
  perceiver.num_freqs = options.num_freqs;
  encoder_ = register_module("encoder", PerceiverEncoder(perceiver));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale / std::sqrt(static_cast<double>(options.width)));
  torch::nn::init::normal_(encoder_->query, 0.0, kScratchQueryDeviation);
}

Tensor ScratchEncoderImpl::forward(const Tensor& points) {
  require_shape(points, {-1, -1, 6}, "points_cloud");
  return encoder_(points.slice(-1, 0, 3), points.slice(-1, 3, 6));
}

TokenProjectionImpl::TokenProjectionImpl(const ProjectionWidths& widths) {
  first_ = register_module("0", nn::Linear(widths.in, widths.hidden_1));
  second_ = register_module("2", nn::Linear(widths.hidden_1, widths.hidden_2));
  third_ = register_module("4", nn::Linear(widths.hidden_2, widths.out));
}

Tensor TokenProjectionImpl::forward(const Tensor& tokens) {
  return third_(nn::gelu_erf(second_(nn::gelu_erf(first_(tokens)))));
}

PooledProjectionImpl::PooledProjectionImpl(const ProjectionWidths& widths, std::int64_t tokens) {
  each_ = register_module("0", TokenProjection(widths));
  sum_ = register_module("1", nn::Linear(tokens, 1));
}

Tensor PooledProjectionImpl::forward(const Tensor& tokens) {
  require_shape(tokens, {-1, sum_->weight.size(1), -1}, "tokens");
  return sum_(each_(tokens).transpose(1, 2)).squeeze(-1);
}

}  // namespace anigen::anymate
