#include "anigen/anymate/blocks.h"

#include <cmath>

#include "anigen/anymate/point_encoders.h"
#include "anigen/core/error.h"
#include "anigen/nn/attention.h"

namespace anigen::anymate {

KeyMask::KeyMask(const Tensor& mask) {
  require_shape(mask, {-1, -1}, "mask");
  const Tensor counts = mask != 0;
  keys_ = mask.size(1);
  if (counts.all().item<bool>()) return;
  for (const Tensor& item : counts.unbind(0)) {
    const Tensor rows = item.nonzero().flatten();
    rows_.push_back(rows.size(0) == keys_ ? Tensor() : rows);
  }
}

Tensor masked_attention(const Tensor& q, const Tensor& k, const Tensor& v, const KeyMask& mask) {
  if (mask.all()) return nn::blocked_attention(q, k, v);
  require(mask.items() == q.size(0) && mask.keys() == k.size(2), "mask",
          "is for " + std::to_string(mask.items()) + " items of " + std::to_string(mask.keys()) + " keys, not " +
              std::to_string(q.size(0)) + " of " + std::to_string(k.size(2)));
  std::vector<Tensor> items;
  for (std::int64_t b = 0; b < mask.items(); ++b) {
    const Tensor queries = q.narrow(0, b, 1), keys = k.narrow(0, b, 1), values = v.narrow(0, b, 1);
    const Tensor& rows = mask.rows(b);
    if (!rows.defined()) {
      items.push_back(nn::blocked_attention(queries, keys, values));
    } else if (rows.size(0) == 0) {
      items.push_back(values.mean(2, /*keepdim=*/true).expand(queries.sizes()));
    } else {
      items.push_back(nn::blocked_attention(queries, keys.index_select(2, rows), values.index_select(2, rows)));
    }
  }
  return torch::cat(items, 0);
}

namespace {

constexpr std::int64_t kMlpRatio = 4;

void require_heads(std::int64_t width, std::int64_t heads) {
  require(width > 0 && heads > 0 && width % heads == 0, "heads",
          std::to_string(heads) + " heads do not divide a width of " + std::to_string(width));
}

// [B, N, H·(parts·d)] → parts views [B, H, N, d]; what belongs to one head lies together.
std::vector<Tensor> heads_of(const Tensor& x, std::int64_t heads, std::int64_t parts) {
  std::vector<Tensor> split = x.view({x.size(0), x.size(1), heads, x.size(2) / heads}).chunk(parts, -1);
  for (Tensor& part : split) part = part.transpose(1, 2);
  return split;
}

// [B, H, N, d] → [B, N, H·d]
Tensor merged_heads(const Tensor& x) { return x.transpose(1, 2).flatten(2); }

void uniform_by_fan_in(const Tensor& weight, const Tensor& bias) {
  const std::int64_t fan_in = weight.numel() / weight.size(0);
  const double bound = 1.0 / std::sqrt(static_cast<double>(fan_in));
  torch::nn::init::uniform_(weight, -bound, bound);
  if (bias.defined()) torch::nn::init::uniform_(bias, -bound, bound);
}

}  // namespace

InterleavedSelfAttentionImpl::InterleavedSelfAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  c_qkv_ = register_module("c_qkv", nn::Linear(width, 3 * width, qkv_bias));
  c_proj_ = register_module("c_proj", nn::Linear(width, width));
}

Tensor InterleavedSelfAttentionImpl::forward(const Tensor& x, const KeyMask& mask) {
  const std::vector<Tensor> qkv = heads_of(c_qkv_(x), heads_, 3);
  return c_proj_(merged_heads(masked_attention(qkv[0], qkv[1], qkv[2], mask)));
}

InterleavedCrossAttentionImpl::InterleavedCrossAttentionImpl(std::int64_t width, std::int64_t data_width,
                                                             std::int64_t heads, bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  c_q_ = register_module("c_q", nn::Linear(width, width, qkv_bias));
  c_kv_ = register_module("c_kv", nn::Linear(data_width, 2 * width, qkv_bias));
  c_proj_ = register_module("c_proj", nn::Linear(width, width));
}

Tensor InterleavedCrossAttentionImpl::forward(const Tensor& x, const Tensor& data, const KeyMask& mask) {
  const Tensor q = heads_of(c_q_(x), heads_, 1)[0];
  const std::vector<Tensor> kv = heads_of(c_kv_(data), heads_, 2);
  return c_proj_(merged_heads(masked_attention(q, kv[0], kv[1], mask)));
}

SeparateAttentionImpl::SeparateAttentionImpl(std::int64_t width, std::int64_t data_width, std::int64_t heads,
                                             bool qkv_bias)
    : heads_(heads) {
  require_heads(width, heads);
  wq_ = register_module("wq", nn::Linear(width, width, qkv_bias));
  wk_ = register_module("wk", nn::Linear(data_width, width, qkv_bias));
  wv_ = register_module("wv", nn::Linear(data_width, width, qkv_bias));
  proj_ = register_module("proj", nn::Linear(width, width));
}

Tensor SeparateAttentionImpl::forward(const Tensor& x, const Tensor& data) {
  const Tensor q = heads_of(wq_(x), heads_, 1)[0], k = heads_of(wk_(data), heads_, 1)[0];
  return proj_(merged_heads(masked_attention(q, k, heads_of(wv_(data), heads_, 1)[0])));
}

ErfMlpImpl::ErfMlpImpl(std::int64_t in, std::int64_t hidden, std::int64_t out, const std::string& first,
                       const std::string& second) {
  first_ = register_module(first, nn::Linear(in, hidden));
  second_ = register_module(second, nn::Linear(hidden, out));
}

ResidualAttentionImpl::ResidualAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias) {
  attention_ = register_module("attn", InterleavedSelfAttention(width, heads, qkv_bias));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kMlpRatio * width, width));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(width, kNormEps));
}

Tensor ResidualAttentionImpl::forward(const Tensor& x, const KeyMask& mask) {
  const Tensor attended = x + attention_(ln_1_(x), mask);
  return attended + mlp_(ln_2_(attended));
}

ResidualCrossAttentionImpl::ResidualCrossAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias,
                                                       std::int64_t data_width) {
  const std::int64_t data = data_width > 0 ? data_width : width;
  attention_ = register_module("attn", InterleavedCrossAttention(width, data, heads, qkv_bias));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(data, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kMlpRatio * width, width));
  ln_3_ = register_module("ln_3", nn::AffineLayerNorm(width, kNormEps));
}

Tensor ResidualCrossAttentionImpl::forward(const Tensor& x, const Tensor& data, const KeyMask& mask) {
  const Tensor attended = x + attention_(ln_1_(x), ln_2_(data), mask);
  return attended + mlp_(ln_3_(attended));
}

ResidualStackImpl::ResidualStackImpl(std::int64_t layers, std::int64_t width, std::int64_t heads, bool qkv_bias) {
  require(layers >= 0, "layers", "must not be negative");
  for (std::int64_t i = 0; i < layers; ++i) blocks_.emplace_back(width, heads, qkv_bias);
  register_module("resblocks", nn::module_list(blocks_));
}

Tensor ResidualStackImpl::forward(Tensor x, const KeyMask& mask) {
  for (ResidualAttention& block : blocks_) x = block->forward(x, mask);
  return x;
}

StreamBlockImpl::StreamBlockImpl(const ReadWriteOptions& options, const std::string& to, const std::string& from) {
  const auto width_of = [&](const std::string& stream) { return stream == "z" ? options.z_dim : options.x_dim; };
  const std::int64_t width = width_of(to);
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(width) * options.mlp_ratio);
  if (from != to) norm_from_ = register_module("norm_" + from, nn::AffineLayerNorm(width_of(from), kNormEps));
  norm_1_ = register_module("norm_" + to + "1", nn::AffineLayerNorm(width, kNormEps));
  attention_ = register_module("attn", SeparateAttention(width, width_of(from), options.num_heads, options.qkv_bias));
  norm_2_ = register_module("norm_" + to + "2", nn::AffineLayerNorm(width, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, hidden, width, "fc1", "fc2"));
}

Tensor StreamBlockImpl::forward(const Tensor& a, const Tensor& b) {
  const Tensor normed = norm_1_(a);
  const Tensor attended = a + attention_(normed, norm_from_.is_empty() ? normed : norm_from_(b));
  return attended + mlp_(norm_2_(attended));
}

ReadComputeWriteImpl::ReadComputeWriteImpl(const ReadWriteOptions& options, std::int64_t compute_layers) {
  read_ = register_module("read", StreamBlock(options, "z", "x"));
  write_ = register_module("write", StreamBlock(options, "x", "z"));
  for (std::int64_t i = 0; i < compute_layers; ++i) compute_.emplace_back(options, "z", "z");
  register_module("compute", nn::module_list(compute_));
}

void ReadComputeWriteImpl::forward(Tensor& z, Tensor& x) {
  z = read_(z, x);
  for (StreamBlock& block : compute_) z = block->forward(z, z);
  x = write_(x, z);
}

VitAttentionImpl::VitAttentionImpl(std::int64_t width, std::int64_t heads) : heads_(heads) {
  require_heads(width, heads);
  qkv_ = register_module("qkv", nn::Linear(width, 3 * width, /*with_bias=*/false));
  proj_ = register_module("proj", nn::Linear(width, width));
}

Tensor VitAttentionImpl::forward(const Tensor& x) {
  const Tensor qkv = qkv_(x).view({x.size(0), x.size(1), 3, heads_, x.size(2) / heads_});
  const std::vector<Tensor> parts = qkv.permute({2, 0, 3, 1, 4}).unbind(0);  // [B, H, N, d] each
  return proj_(masked_attention(parts[0], parts[1], parts[2]).transpose(1, 2).flatten(2));
}

VitBlockImpl::VitBlockImpl(std::int64_t width, std::int64_t heads, double drop_path) : drop_path_(drop_path) {
  require(drop_path >= 0.0 && drop_path < 1.0, "drop_path_rate", "must be in [0, 1)");
  norm1_ = register_module("norm1", nn::AffineLayerNorm(width, kNormEps));
  norm2_ = register_module("norm2", nn::AffineLayerNorm(width, kNormEps));
  mlp_ = register_module("mlp", ErfMlp(width, kMlpRatio * width, width, "fc1", "fc2"));
  attention_ = register_module("attn", VitAttention(width, heads));
}

Tensor VitBlockImpl::kept(const Tensor& branch) const {
  if (!is_training() || drop_path_ == 0.0) return branch;
  const double keep = 1.0 - drop_path_;
  return branch * torch::bernoulli(torch::full({branch.size(0), 1, 1}, keep, branch.options())).div_(keep);
}

Tensor VitBlockImpl::forward(const Tensor& x) {
  const Tensor attended = x + kept(attention_(norm1_(x)));
  return attended + kept(mlp_(norm2_(attended)));
}

void default_layers(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* linear = part.as<nn::LinearImpl>()) uniform_by_fan_in(linear->weight, linear->bias);
    if (auto* convolution = part.as<PointwiseConvImpl>()) uniform_by_fan_in(convolution->weight, convolution->bias);
  });
  nn::default_norms(module);
}

void normal_blocks(torch::nn::Module& module, double std) {
  module.apply([std](torch::nn::Module& block) {
    if (block.as<ResidualAttentionImpl>() == nullptr && block.as<ResidualCrossAttentionImpl>() == nullptr) return;
    block.apply([std](torch::nn::Module& part) {
      if (auto* linear = part.as<nn::LinearImpl>()) nn::normal_linear(*linear, std);
    });
  });
}

void start_blocks(torch::nn::Module& module, double std, nn::Init init) {
  if (init == nn::Init::kNone) return;
  default_layers(module);
  normal_blocks(module, std);
}

void require(bool condition, const std::string& what, const std::string& problem) {
  if (!condition) throw InputError("", what, problem);
}

void require_shape(const Tensor& tensor, const std::vector<std::int64_t>& shape, const std::string& what) {
  bool fits = tensor.defined() && tensor.dim() == static_cast<std::int64_t>(shape.size());
  for (std::size_t axis = 0; fits && axis < shape.size(); ++axis)
    fits = shape[axis] < 0 || tensor.size(static_cast<std::int64_t>(axis)) == shape[axis];
  if (fits) return;
  throw InputError("", what, "has shape " + nn::shape_text(tensor) + ", not " + nn::shape_text(shape) + " (-1: any)");
}

}  // namespace anigen::anymate
