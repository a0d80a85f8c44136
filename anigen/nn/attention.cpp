#include "anigen/nn/attention.h"

#include <cmath>
#include <vector>

namespace anigen::nn {
namespace {

void check(const AttentionOptions& options) {
  TORCH_CHECK(options.num_heads > 0 && options.channels % options.num_heads == 0, "attention with ", options.channels,
              " channels cannot have ", options.num_heads, " heads");
}

// [..., N, parts·h·d] → parts tensors [..., h, N, d].
std::vector<Tensor> split_heads(const Tensor& x, std::int64_t parts, std::int64_t heads) {
  std::vector<std::int64_t> shape(x.sizes().begin(), x.sizes().end() - 1);
  shape.insert(shape.end(), {parts, heads, x.size(-1) / (parts * heads)});
  std::vector<Tensor> split = x.view(shape).unbind(-3);
  for (Tensor& part : split) part = part.transpose(-3, -2);
  return split;
}

// [..., h, N, d] → [..., N, h·d]
Tensor join_heads(const Tensor& x) { return x.transpose(-3, -2).flatten(-2); }

Tensor attend_heads(const Tensor& qkv, std::int64_t heads, const Tensor& mask) {
  const std::vector<Tensor> parts = split_heads(qkv, 3, heads);
  return join_heads(attend(parts[0], parts[1], parts[2], mask));
}

}  // namespace

Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask) {
  const torch::Dtype dtype = dtype_of(q);
  const double scale = 1.0 / std::sqrt(static_cast<double>(q.size(-1)));
  Tensor scores = torch::matmul(q * scale, k.transpose(-2, -1));
  if (mask.defined()) scores = scores + mask;
  const Tensor weights = torch::softmax(scores, -1, accumulation_dtype(dtype)).to(dtype);
  return torch::matmul(weights, v);
}

SelfAttentionImpl::SelfAttentionImpl(const AttentionOptions& options) : num_heads_(options.num_heads) {
  check(options);
  to_qkv_ = register_module("to_qkv", Linear(options.channels, 3 * options.channels, options.qkv_bias));
  to_out_ = register_module("to_out", Linear(options.channels, options.channels));
}

Tensor SelfAttentionImpl::forward(const Tensor& x, const Ragged& items) {
  const Tensor qkv = to_qkv_->forward(x);
  Tensor mixed;
  if (items.padding_pays()) {
    mixed = items.unpad(attend_heads(items.pad(qkv), num_heads_, items.key_mask(qkv.options())));
  } else {
    std::vector<Tensor> parts;
    for (const Tensor& item : items.split(qkv)) parts.push_back(attend_heads(item, num_heads_, {}));
    mixed = torch::cat(parts, 0);
  }
  return to_out_->forward(mixed);
}

CrossAttentionImpl::CrossAttentionImpl(const AttentionOptions& options) : num_heads_(options.num_heads) {
  check(options);
  const std::int64_t context = options.context_channels > 0 ? options.context_channels : options.channels;
  to_q_ = register_module("to_q", Linear(options.channels, options.channels, options.qkv_bias));
  to_kv_ = register_module("to_kv", Linear(context, 2 * options.channels, options.qkv_bias));
  to_out_ = register_module("to_out", Linear(options.channels, options.channels));
}

Tensor CrossAttentionImpl::forward(const Tensor& x, const Ragged& items, const Tensor& context,
                                   const Ragged& context_items) {
  TORCH_CHECK(items.items() == context_items.items(), "cross attention of ", items.items(), " items to ",
              context_items.items(), " contexts");
  const std::vector<Tensor> queries = items.split(to_q_->forward(x));
  const std::vector<Tensor> contexts = context_items.split(to_kv_->forward(context));
  std::vector<Tensor> mixed;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const Tensor q = split_heads(queries[i], 1, num_heads_)[0];
    const std::vector<Tensor> kv = split_heads(contexts[i], 2, num_heads_);
    mixed.push_back(join_heads(attend(q, kv[0], kv[1])));
  }
  return to_out_->forward(torch::cat(mixed, 0));
}

}  // namespace anigen::nn
