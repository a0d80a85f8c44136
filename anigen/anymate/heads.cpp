#include "anigen/anymate/heads.h"

#include <algorithm>
#include <string>
#include <vector>

#include "anigen/anymate/denoisers.h"
#include "anigen/geometry/nearest_point.h"

namespace anigen::anymate {

namespace {

constexpr double kLogFloor = 1e-6, kMasked = -1e8, kLeastLength = 1e-6, kRoleTokenDeviation = 0.02;
constexpr double kStretch = 1.002, kShift = 0.001;  // so that a softmax can reach 0 and 1
constexpr std::size_t kBranches = 2;
constexpr std::int64_t kChainWidth = 512;
constexpr std::int64_t kPointsAtOnce = 8192;  // whose hidden layer of four times the width is the largest tensor

// The joints or bones that a mask speaks of, [B, K, C]; all without one.
Tensor masked_rows(const Tensor& latents, const Tensor& rows, const Tensor& mask, std::int64_t width,
                   std::int64_t channels, const char* name) {
  require_shape(latents, {-1, -1, width}, "latents");
  require_shape(rows, {latents.size(0), -1, channels}, name);
  if (!mask.defined()) return rows;
  const std::string of_mask = std::string(name) + "_mask";
  require_shape(mask, {rows.size(0), -1}, of_mask);
  require(mask.size(1) <= rows.size(1), of_mask, std::string("is for more ") + name + " than there are");
  return rows.narrow(1, 0, mask.size(1));
}

Tensor checked_bones(const SkinningInput& input, std::int64_t width) {
  require_shape(input.points, {input.latents.size(0), -1, 6}, "points");
  return masked_rows(input.latents, input.bones, input.mask, width, 6, "bones");
}

// Logits [B, N, K] with -1e8 in the columns that the mask leaves out.
Tensor masked_columns(const Tensor& logits, const Tensor& mask) {
  return mask.defined() ? logits.masked_fill((mask == 0).unsqueeze(1), kMasked) : logits;
}

Tensor mean_cosine(const Tensor& a, const Tensor& b) {
  const Tensor a_length = a.norm(2, -1, true).clamp_min(kLeastLength),
               b_length = b.norm(2, -1, true).clamp_min(kLeastLength);
  return ((a / a_length) * (b / b_length)).sum(-1).mean();
}

// True parents of the joints that there are logits of, [B, J, J].
Tensor checked_truth(const Tensor& logits, const Tensor& parents) {
  require_shape(logits, {-1, -1, -1}, "logits");
  const std::int64_t joints = logits.size(1);
  require_shape(logits, {-1, joints, joints}, "logits");
  require_shape(parents, {logits.size(0), -1, joints}, "conns");
  require(parents.size(1) >= joints, "conns", "has fewer rows than there are joints");
  return parents.narrow(1, 0, joints).to(logits.dtype());
}

}  // namespace

PairLogits::PairLogits(torch::nn::Module& head, std::int64_t width) {
  q_proj_ = head.register_module("q_proj", nn::Linear(width, width));
  k_proj_ = head.register_module("k_proj", nn::Linear(width, width));
  ln_1_ = head.register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  ln_2_ = head.register_module("ln_2", nn::AffineLayerNorm(width, kNormEps));
}

Tensor connectivity_loss(const Tensor& logits, const Tensor& parents) {
  const Tensor truth = checked_truth(logits, parents);
  return -(truth * (torch::softmax(logits, -1) + kLogFloor).log()).sum(-1).mean();
}

Tensor connectivity_bce(const Tensor& logits, const Tensor& parents, const Tensor& mask) {
  const Tensor truth = checked_truth(logits, parents);
  Tensor counts = torch::ones_like(logits);
  if (mask.defined()) {
    require_shape(mask, {logits.size(0), logits.size(1)}, "joints_mask");
    const Tensor real = (mask != 0).to(logits.dtype());
    counts = real.unsqueeze(2) * real.unsqueeze(1);
  }
  const Tensor sum = torch::binary_cross_entropy(torch::softmax(logits, -1), truth, counts, at::Reduction::Sum);
  return sum / counts.sum().clamp_min(1.0);
}

Tensor likeliest_parents(const Tensor& logits) {
  require(logits.defined() && (logits.dim() == 2 || logits.dim() == 3) && logits.size(-1) == logits.size(-2), "logits",
          "must be [J, J] or [B, J, J]");
  return logits.argmax(-1);
}

Tensor bones_of(const Tensor& joints, const Tensor& parents) {
  require_shape(joints, {-1, 3}, "joints");
  const std::int64_t count = joints.size(0);
  require_shape(parents, {count}, "parents");
  const Tensor parent = parents.to(joints.device(), torch::kInt64);
  require(count == 0 || (parent.min().item<std::int64_t>() >= 0 && parent.max().item<std::int64_t>() < count),
          "parents", "holds an index outside [0, " + std::to_string(count) + ")");
  const Tensor children = (parent != torch::arange(count, parent.options())).nonzero().flatten();
  return torch::cat({joints.index_select(0, parent.index_select(0, children)), joints.index_select(0, children)}, 1);
}

TwoBranchConnectivityImpl::TwoBranchConnectivityImpl(const HeadOptions& options, std::int64_t layers, nn::Init init)
    : options_(options) {
  require(layers > 0, "layers", "must be positive");
  const std::int64_t width = options.width;
  co_proj_ = register_module("co_proj", nn::Linear(fourier_width(options.num_freqs), width));
  for (std::int64_t j = 0; j < layers; ++j) cross_attn_.emplace_back(width, options.heads, options.qkv_bias);
  for (std::size_t j = 0; j < kBranches * cross_attn_.size(); ++j)
    self_attn_.emplace_back(width, options.heads, options.qkv_bias);
  register_module("cross_attn", nn::module_list(cross_attn_));
  register_module("self_attn", nn::module_list(self_attn_));
  pairs_ = PairLogits(*this, width);
  start_blocks(*this, options.init_scale, init);
}

Tensor TwoBranchConnectivityImpl::forward(const Tensor& latents, const Tensor& joints, const Tensor& mask) {
  const Tensor positions = masked_rows(latents, joints, mask, options_.width, 3, "joints");
  const KeyMask keys = mask.defined() ? KeyMask(mask) : KeyMask();
  const Tensor embedded = co_proj_(fourier_features(positions, options_.num_freqs, /*include_pi=*/true));
  std::vector<Tensor> branches;
  for (std::size_t branch = 0; branch < kBranches; ++branch) {
    Tensor x = embedded;
    for (std::size_t j = 0; j < cross_attn_.size(); ++j) {
      x = cross_attn_[j](x, latents);
      x = self_attn_[branch * cross_attn_.size() + j](x, keys);
    }
    branches.push_back(x);
  }
  return masked_columns(with_children_in_rows(pairs_.of(branches[0], pairs_.columns(branches[1]))), mask);
}

LinearChainImpl::LinearChainImpl(std::int64_t in, std::int64_t out) {
  first_ = register_module("0", nn::Linear(in, kChainWidth));
  second_ = register_module("1", nn::Linear(kChainWidth, kChainWidth));
  third_ = register_module("2", nn::Linear(kChainWidth, out));
  norm_ = register_module("3", nn::AffineLayerNorm(out, kNormEps));
}

TokenConnectivityImpl::TokenConnectivityImpl(const HeadOptions& options, std::int64_t layers, std::int64_t token_length,
                                             nn::Init init)
    : options_(options) {
  const std::int64_t width = options.width;
  head_token_ = register_parameter("head_token", torch::empty({1, 1, token_length}));
  tail_token_ = register_parameter("tail_token", torch::empty({1, 1, token_length}));
  layer_norm_ = register_module("layer_norm", nn::AffineLayerNorm(width, kNormEps));
  head_mlp_ = register_module("head_mlp", LinearChain(width + token_length, width));
  tail_mlp_ = register_module("tail_mlp", LinearChain(width + token_length, width));
  self_attn_ = register_module("self_attn", ResidualStack(layers, width, options.heads, options.qkv_bias));
  joints_proj_ = register_module("joints_proj", nn::Linear(fourier_width(options.num_freqs), width));
  output_proj_joints_ = register_module("output_proj_joints", nn::Linear(width, width));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
  torch::nn::init::normal_(head_token_, 0.0, kRoleTokenDeviation);
  torch::nn::init::normal_(tail_token_, 0.0, kRoleTokenDeviation);
}

Tensor TokenConnectivityImpl::forward(const Tensor& latents, const Tensor& joints, const Tensor& mask) {
  const Tensor positions = masked_rows(latents, joints, mask, options_.width, 3, "joints");
  KeyMask keys;
  if (mask.defined()) {
    const Tensor latents_count = torch::ones({latents.size(0), latents.size(1)}, mask.options());
    keys = KeyMask(torch::cat({mask, latents_count}, 1));
  }
  const Tensor embedded = joints_proj_(fourier_features(positions, options_.num_freqs, /*include_pi=*/true));
  const Tensor all = self_attn_(torch::cat({embedded, latents}, 1), keys);
  const Tensor found = output_proj_joints_(layer_norm_(all.slice(1, 0, positions.size(1))));
  const auto in_role = [&](LinearChain& chain, const Tensor& token) {
    return chain(torch::cat({found, token.expand({found.size(0), found.size(1), -1})}, -1));
  };
  return with_children_in_rows(
      torch::matmul(in_role(head_mlp_, head_token_), in_role(tail_mlp_, tail_token_).transpose(1, 2)));
}

SkinningEmbedding::SkinningEmbedding(torch::nn::Module& head, const HeadOptions& options, bool separate)
    : num_freqs_(options.num_freqs) {
  const std::int64_t position = fourier_width(options.num_freqs), width = options.width;
  bone_proj_ = head.register_module("bone_proj", nn::Linear(2 * position, width));
  if (separate) {
    pc_proj_ = head.register_module("pc_proj", nn::Linear(position + kHarmonics, width));
  } else {
    co_proj_ = head.register_module("co_proj", nn::Linear(position, width));
    normal_proj_ = head.register_module("normal_proj", nn::Linear(kHarmonics, width));
  }
}

Tensor SkinningEmbedding::points(const Tensor& points) {
  const Tensor position = fourier_features(points.slice(-1, 0, 3), num_freqs_, /*include_pi=*/true);
  const Tensor normal = spherical_harmonics(points.slice(-1, 3, 6));
  if (!pc_proj_.is_empty()) return pc_proj_(torch::cat({position, normal}, -1));
  return co_proj_(position) + normal_proj_(normal);
}

Tensor SkinningEmbedding::bones(const Tensor& bones) {
  const Tensor head = fourier_features(bones.slice(-1, 0, 3), num_freqs_, /*include_pi=*/true);
  const Tensor tail = fourier_features(bones.slice(-1, 3, 6), num_freqs_, /*include_pi=*/true);
  return bone_proj_(torch::cat({head, tail}, -1));
}

Tensor training_points(std::int64_t points, std::int64_t count) {
  require(count > 0 && count <= points, "count",
          std::to_string(count) + " of " + std::to_string(points) + " points were asked for");
  return torch::randperm(points, torch::kInt64).slice(0, 0, count);
}

Tensor nearest_point_logits(const Tensor& vertices, const Tensor& points, const Tensor& logits) {
  require_shape(logits, {points.defined() && points.dim() == 2 ? points.size(0) : -1, -1}, "logits");
  const geometry::PointIndex tree(nn::points_of<double>(points, "points"));
  const std::vector<std::size_t> nearest = tree.nearest(nn::points_of<double>(vertices, "vertices"));
  const std::vector<std::int64_t> rows(nearest.begin(), nearest.end());
  return logits.index_select(0, torch::tensor(rows, torch::kInt64).to(logits.device()));
}

SkinningLosses skinning_losses(const Tensor& logits, const Tensor& truth) {
  require_shape(logits, {-1, -1, -1}, "logits");
  require_shape(truth, logits.sizes().vec(), "skins");
  const Tensor weights = torch::softmax(logits, -1);
  SkinningLosses losses;
  losses.cos = 1.0 - mean_cosine(weights, truth);
  losses.cos_clamp = 1.0 - mean_cosine((kStretch * weights - kShift).clamp(0.0, 1.0), truth);
  losses.ce = -(truth * (weights + kLogFloor).log()).sum(-1).mean();
  return losses;
}

CrossSkinningImpl::CrossSkinningImpl(const HeadOptions& options, std::int64_t layers, bool separate, nn::Init init)
    : options_(options), embedding_(*this, options, separate) {
  require(layers > 0, "layers", "must be positive");
  const std::int64_t width = options.width;
  for (std::int64_t i = 0; i < layers; ++i) {
    cross_attn_.emplace_back(width, options.heads, options.qkv_bias);
    cross_attn_joint_.emplace_back(width, options.heads, options.qkv_bias);
  }
  register_module("cross_attn", nn::module_list(cross_attn_));
  register_module("cross_attn_joint", nn::module_list(cross_attn_joint_));
  pairs_ = PairLogits(*this, width);
  start_blocks(*this, options.init_scale, init);
}

std::vector<Tensor> CrossSkinningImpl::bone_stream(const Tensor& bones, const Tensor& latents, const KeyMask& keys) {
  std::vector<Tensor> tokens;
  Tensor x = embedding_.bones(bones);
  for (std::size_t i = 0; i < cross_attn_.size(); ++i) {
    tokens.push_back(cross_attn_[i](x, latents));
    x = cross_attn_joint_[i](tokens.back(), tokens.back(), keys);
  }
  tokens.push_back(x);
  return tokens;
}

Tensor CrossSkinningImpl::forward(const SkinningInput& input, std::int64_t chunk) {
  require(chunk >= 0, "chunk", "must not be negative");
  const Tensor bones = checked_bones(input, options_.width);
  const KeyMask keys = input.mask.defined() ? KeyMask(input.mask) : KeyMask();
  const std::vector<Tensor> tokens = bone_stream(bones, input.latents, keys);
  const Tensor columns = pairs_.columns(tokens.back());
  if (chunk == 0)
    chunk = torch::GradMode::is_enabled() ? std::max<std::int64_t>(input.points.size(1), 1) : kPointsAtOnce;
  std::vector<Tensor> parts;
  for (const Tensor& part : input.points.split(chunk, 1)) {
    Tensor x = embedding_.points(part);
    for (std::size_t i = 0; i < cross_attn_.size(); ++i) {
      x = cross_attn_[i](x, input.latents);
      x = cross_attn_joint_[i](x, tokens[i], keys);
    }
    parts.push_back(pairs_.of(x, columns));
  }
  return masked_columns(torch::cat(parts, 1), input.mask);
}

ConcatSkinningImpl::ConcatSkinningImpl(const HeadOptions& head, const ConcatSkinningOptions& options, nn::Init init)
    : head_(head), options_(options) {
  require(options.concat_num > 0, "concat_num", "must be positive");
  const std::int64_t width = head.width;
  self_attn_ = register_module("self_attn", ResidualStack(options.layers, width, head.heads, head.qkv_bias));
  embedding_ = SkinningEmbedding(*this, head, options.separate);
  output_proj_joints_ = register_module("output_proj_joints", nn::Linear(width, width));
  output_proj_points_ = register_module("output_proj_points", nn::Linear(width, width));
  layer_norm_ = register_module("layer_norm", nn::AffineLayerNorm(width, kNormEps));
  start_blocks(*this, head.init_scale, init);
}

Tensor ConcatSkinningImpl::run_logits(const Tensor& points, const Tensor& bones, const Tensor& latents,
                                      const Tensor& masks) {
  const std::int64_t run = options_.concat_num, items = points.size(0), runs = points.size(1) / run;
  const std::int64_t count = bones.size(1);
  KeyMask keys;
  if (masks.defined()) {
    const Tensor others = torch::ones({items * runs, run + latents.size(1)}, masks.options());
    keys = KeyMask(torch::cat({masks.reshape({items * runs, count}), others}, 1));
  }
  // Sequences item after item, [B · runs, …].
  const Tensor of_runs = points.reshape({items * runs, run, points.size(2)});
  const Tensor sequence =
      torch::cat({bones.repeat_interleave(runs, 0), of_runs, latents.repeat_interleave(runs, 0)}, 1);
  const Tensor x = layer_norm_(self_attn_(sequence, keys).slice(1, 0, count + run));
  const Tensor columns = output_proj_joints_(x.slice(1, 0, count)), rows = output_proj_points_(x.slice(1, count));
  return torch::matmul(rows, columns.transpose(1, 2)).view({items, runs * run, count});
}

Tensor ConcatSkinningImpl::forward(const SkinningInput& input, std::int64_t chunk) {
  const Tensor bones = embedding_.bones(checked_bones(input, head_.width));
  const std::int64_t run = options_.concat_num, items = bones.size(0), points = input.points.size(1);
  const std::int64_t at_once = chunk == 0 ? run : chunk;
  require(at_once > 0 && at_once % run == 0, "chunk", "must be a multiple of concat_num, " + std::to_string(run));
  require(points > 0 && points % run == 0, "points",
          std::to_string(points) + " points are not a whole number of runs of " + std::to_string(run));
  Tensor masks;  // [B, runs, K]
  if (input.mask.defined()) {
    const Tensor tiled = input.mask.repeat({points / run, 1}).view({items, points / run, -1});
    masks = options_.tiled_masks ? tiled : input.mask.unsqueeze(1).expand_as(tiled);
  }
  std::vector<Tensor> parts;
  for (std::int64_t first = 0; first < points; first += at_once) {
    const std::int64_t size = std::min(at_once, points - first);
    const Tensor tokens = embedding_.points(input.points.narrow(1, first, size));
    const Tensor own = masks.defined() ? masks.narrow(1, first / run, size / run) : masks;
    parts.push_back(run_logits(tokens, bones, input.latents, own));
  }
  return masked_columns(torch::cat(parts, 1), input.mask);
}

}  // namespace anigen::anymate
