#include "anigen/nn/attention.h"

#include <algorithm>
#include <cmath>

#include "anigen/nn/condition_cache.h"
#include "anigen/nn/kernels/attention_bf16.h"
#include "anigen/nn/kernels/attention_fp32.h"

namespace anigen::nn {

namespace {

constexpr std::int64_t kFewScores = 65536;             // below it, blocks cost more than they save
constexpr std::int64_t kShortRows = 256;               // sequences up to it have kernels without a product per head
constexpr std::int64_t kMostTensorScores = 1LL << 25;  // of all heads together in tensor_blocked_attention

// [B, H, N, D] → [B · N, H, D], a view of what a projection left.
Tensor as_rows(const Tensor& x) { return x.transpose(1, 2).flatten(0, 1); }

Tensor offsets_of(const Tensor& x) {
  return torch::arange(x.size(0) + 1, torch::TensorOptions().dtype(torch::kInt64)) * x.size(2);
}

// Calls of a product cost as much as the products of short sequences themselves.
Tensor attention_of_sequences(const Tensor& q, const Tensor& k, const Tensor& v) {
  const Tensor mixed = ragged_attention(as_rows(q), as_rows(k), as_rows(v), offsets_of(q), offsets_of(k));
  return mixed.view({q.size(0), q.size(2), q.size(1), q.size(3)}).transpose(1, 2);
}

double score_scale(const Tensor& q) { return 1.0 / std::sqrt(static_cast<double>(q.size(-1))); }

// Scaled scores of some queries with all keys, in the type of sums.
Tensor wide_scores(const Tensor& q_rows, const Tensor& k) {
  const Tensor scores = torch::matmul(q_rows * score_scale(q_rows), k.transpose(-2, -1));
  return scores.to(accumulation_dtype(dtype_of(scores)));
}

class TensorBlockedAttention : public torch::autograd::Function<TensorBlockedAttention> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& q, const Tensor& k, const Tensor& v,
                        std::int64_t rows) {
    std::vector<Tensor> out, log_sums;
    for (std::int64_t i = 0; i < q.size(2); i += rows) {
      const Tensor scores = wide_scores(q.narrow(2, i, std::min(rows, q.size(2) - i)), k);
      log_sums.push_back(scores.logsumexp(-1, /*keepdim=*/true));
      out.push_back(torch::matmul((scores - log_sums.back()).exp_().to(dtype_of(q)), v));
    }
    const Tensor result = torch::cat(out, 2);
    context->save_for_backward({q, k, v, result, torch::cat(log_sums, 2)});
    context->saved_data["rows"] = rows;
    return result;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = saved_once(*context, "blocked attention");
    const Tensor &q = saved[0], &k = saved[1], &v = saved[2], &out = saved[3], &log_sums = saved[4], &dy = gradients[0];
    const std::int64_t rows = context->saved_data["rows"].toInt();
    const torch::Dtype dtype = dtype_of(q), wide = dtype_of(log_sums);
    const Tensor delta = (dy.to(wide) * out.to(wide)).sum(-1, /*keepdim=*/true);
    Tensor dk = torch::zeros(k.sizes(), k.options().dtype(wide)), dv = torch::zeros_like(dk);
    std::vector<Tensor> dq;
    for (std::int64_t i = 0; i < q.size(2); i += rows) {
      const auto block = [&](const Tensor& x) { return x.narrow(2, i, std::min(rows, x.size(2) - i)); };
      const Tensor q_rows = block(q), dy_rows = block(dy);
      const Tensor weights = (wide_scores(q_rows, k) - block(log_sums)).exp_();
      const Tensor slopes = torch::matmul(dy_rows, v.transpose(-2, -1)).to(wide);
      const Tensor dscores = ((slopes - block(delta)).mul_(weights) * score_scale(q)).to(dtype);
      dv.add_(torch::matmul(weights.to(dtype).transpose(-2, -1), dy_rows));
      dk.add_(torch::matmul(dscores.transpose(-2, -1), q_rows));
      dq.push_back(torch::matmul(dscores, k));
    }
    return {torch::cat(dq, 2), dk.to(dtype), dv.to(dtype), Tensor()};
  }
};

}  // namespace

Tensor blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  TORCH_CHECK(q.dim() == 4 && k.dim() == 4 && v.sizes() == k.sizes() && q.size(0) == k.size(0) &&
                  q.size(1) == k.size(1) && q.size(3) == k.size(3) && k.size(2) > 0,
              "attention of queries ", q.sizes(), " to keys ", k.sizes(), " and values ", v.sizes());
  TORCH_CHECK(dtype_of(q) == dtype_of(k) && dtype_of(q) == dtype_of(v), "attention of queries of type ", q.dtype(),
              " to keys of type ", k.dtype(), " and values of type ", v.dtype());
  const std::int64_t per_query = q.size(0) * q.size(1) * k.size(2), scores = per_query * q.size(2);
  const bool half_on_cpu = q.is_cpu() && dtype_of(q) == torch::kHalf;  // not every LibTorch multiplies these
  if (scores == 0 || (scores < kFewScores && !half_on_cpu)) return attend(q, k, v);
  if (q.is_cpu() && dtype_of(q) != torch::kFloat64) {
    const bool is_short = q.size(2) <= kShortRows && k.size(2) <= kShortRows;
    if (is_short || prefers_mixed_attention(q)) return attention_of_sequences(q, k, v);
    return cpu_blocked_attention(q, k, v);
  }
  if (kHasFusedAttention && q.is_cuda()) return fused_attention(q, k, v);
  return tensor_blocked_attention(q, k, v, std::max<std::int64_t>(1, kMostTensorScores / per_query));
}

Tensor tensor_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t rows) {
  return TensorBlockedAttention::apply(q, k, v, rows);
}

Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask) {
  const torch::Dtype dtype = dtype_of(q);
  Tensor scores = torch::matmul(q * score_scale(q), k.transpose(-2, -1));
  if (mask.defined()) scores = scores + mask;
  const Tensor weights = torch::softmax(scores, -1, accumulation_dtype(dtype)).to(dtype);
  return torch::matmul(weights, v);
}

AttentionLayers::AttentionLayers(const AttentionOptions& options) : attention_(options) {
  TORCH_CHECK(options.num_heads > 0 && options.channels > 0 && options.channels % options.num_heads == 0,
              "attention with ", options.channels, " channels cannot have ", options.num_heads, " heads");
  TORCH_CHECK(options.context_channels > 0 || !options.x_is_query, "x_is_query is an option of cross attention");
  const std::int64_t channels = options.channels, context = options.context_channels;
  if (context == 0) {
    to_qkv_ = register_module("to_qkv", Linear(channels, 3 * channels, options.qkv_bias, options.lora_qkv));
  } else {
    if (!options.x_is_query)
      to_q_ = register_module("to_q", Linear(channels, channels, options.qkv_bias, options.lora_qkv));
    to_kv_ = register_module("to_kv", Linear(context, 2 * channels, options.qkv_bias, options.lora_qkv));
  }
  if (options.qk_rms_norm) {
    const std::int64_t heads = options.num_heads;
    q_rms_norm_ = register_module("q_rms_norm", MultiHeadRmsNorm(channels / heads, heads));
    k_rms_norm_ = register_module("k_rms_norm", MultiHeadRmsNorm(channels / heads, heads));
  }
  to_out_ = register_module("to_out", Linear(channels, channels, /*with_bias=*/true, options.lora_out));
}

std::vector<Tensor> AttentionLayers::heads_of(const Tensor& x, std::int64_t parts) const {
  std::vector<std::int64_t> shape = x.sizes().vec();
  const std::int64_t head_channels = shape.back() / (parts * attention_.num_heads);
  shape.back() = parts;
  shape.insert(shape.end(), {attention_.num_heads, head_channels});
  return x.view(shape).unbind(-3);
}

std::vector<Tensor> DenseAttentionImpl::keys_and_values(const Tensor& context) {
  return projected_context(this, context, [&] {
    std::vector<Tensor> kv = heads_of(to_kv_->forward(context), 2);
    if (!k_rms_norm_.is_empty()) kv[0] = k_rms_norm_->forward(kv[0]);
    return kv;
  });
}

std::vector<Tensor> DenseAttentionImpl::self_heads(const Tensor& x) {
  std::vector<Tensor> qkv = heads_of(to_qkv_->forward(x), 3);
  if (!q_rms_norm_.is_empty()) {
    qkv[0] = q_rms_norm_->forward(qkv[0]);
    qkv[1] = k_rms_norm_->forward(qkv[1]);
  }
  return qkv;
}

Tensor DenseAttentionImpl::forward_in_windows(const Tensor& x, const GridWindows& windows) {
  const std::int64_t tokens = windows.side * windows.side * windows.side;
  TORCH_CHECK(!to_qkv_.is_empty(), "dense attention: cross attention has no windows");
  TORCH_CHECK(x.dim() == 3 && x.size(1) == tokens && x.size(2) == attention_.channels, "attention inside windows of a ",
              windows.side, "³ grid over ", attention_.channels, " channels: input ", x.sizes());
  const TokenOrder by_window = token_order(windows);
  const std::vector<Tensor> qkv = self_heads(x.index_select(1, by_window.order.on(x.device())));
  // Windows of all items, one after another.
  const Tensor items = torch::arange(x.size(0), torch::kInt64).unsqueeze(1) * tokens;
  const Tensor begins = (items + by_window.offsets.slice(0, 0, -1)).flatten();
  const Tensor offsets = torch::cat({begins, torch::full({1}, x.size(0) * tokens, torch::kInt64)});
  const auto rows = [](const Tensor& part) { return part.flatten(0, 1); };
  const Tensor mixed = ragged_attention(rows(qkv[0]), rows(qkv[1]), rows(qkv[2]), offsets, offsets);
  return to_out_->forward(mixed.view(x.sizes()).index_select(1, by_window.places.on(x.device())));
}

Tensor DenseAttentionImpl::forward(const Tensor& x, const Tensor& context) {
  TORCH_CHECK(x.dim() == 3 && x.size(2) == attention_.channels, "dense attention over ", attention_.channels,
              " channels: input ", x.sizes());
  TORCH_CHECK(context.defined() == to_qkv_.is_empty(), "dense attention: ",
              context.defined() ? "self attention was given a context" : "cross attention needs a context");
  std::vector<Tensor> qkv;
  if (context.defined()) {
    TORCH_CHECK(context.dim() == 3 && context.size(0) == x.size(0), "cross attention: input ", x.sizes(), ", context ",
                context.sizes());
    qkv = heads_of(to_q_.is_empty() ? x.contiguous() : to_q_->forward(x), 1);
    if (!q_rms_norm_.is_empty()) qkv[0] = q_rms_norm_->forward(qkv[0]);
    for (const Tensor& part : keys_and_values(context)) qkv.push_back(part);
  } else {
    qkv = self_heads(x);
  }
  const Tensor mixed = blocked_attention(qkv[0].transpose(1, 2), qkv[1].transpose(1, 2), qkv[2].transpose(1, 2));
  return to_out_->forward(mixed.transpose(1, 2).reshape(x.sizes()));
}

Tensor RaggedAttentionImpl::forward(const Tensor& x, const Ragged& items) {
  return to_out_->forward(attend_self(x, items.row_offsets()));
}

Tensor RaggedAttentionImpl::forward(const Tensor& x, const Ragged& items, const Tensor& context,
                                    const Ragged& context_items) {
  TORCH_CHECK(items.items() == context_items.items(), "cross attention of ", items.items(), " items to ",
              context_items.items(), " contexts");
  return to_out_->forward(
      attend_cross(to_q_->forward(x), to_kv_->forward(context), items.row_offsets(), context_items.row_offsets()));
}

Tensor RaggedAttentionImpl::attend_self(const Tensor& x, const Tensor& offsets) {
  const std::vector<Tensor> qkv = heads_of(to_qkv_->forward(x), 3);
  return attend_heads(qkv[0], qkv[1], qkv[2], offsets, offsets);
}

Tensor RaggedAttentionImpl::attend_cross(const Tensor& queries, const Tensor& keys_values, const Tensor& q_offsets,
                                         const Tensor& k_offsets) {
  const std::vector<Tensor> kv = heads_of(keys_values, 2);
  return attend_heads(heads_of(queries, 1)[0], kv[0], kv[1], q_offsets, k_offsets);
}

Tensor RaggedAttentionImpl::attend_heads(Tensor q, Tensor k, const Tensor& v, const Tensor& q_offsets,
                                         const Tensor& k_offsets) {
  if (!q_rms_norm_.is_empty()) {
    q = q_rms_norm_->forward(q);
    k = k_rms_norm_->forward(k);
  }
  return ragged_attention(q, k, v, q_offsets, k_offsets).flatten(1);
}

}  // namespace anigen::nn
