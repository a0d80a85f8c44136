#include "anigen/sparse/attention.h"

#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/sparse/windows.h"

namespace anigen::sparse {

namespace {

// [N, parts · C] → views [N, H, D] of the parts.
std::vector<Tensor> row_heads(const Tensor& x, std::int64_t parts, std::int64_t heads) {
  return x.view({x.size(0), parts, heads, x.size(1) / (parts * heads)}).unbind(1);
}

}  // namespace

AttentionScope AttentionScope::of(const std::string& mode, std::int64_t window, std::int64_t shift) {
  AttentionScope scope;
  if (mode == "full") return scope;
  for (const char* curve : {"serialized", "shift_window", "shift_sequence", "shift_order"}) {
    if (mode == curve) {
      throw NotSupportedError("", "", "serialized attention (mode '" + mode + "'); use 'swin' or 'full'");
    }
  }
  if (mode != "swin" && mode != "windowed") {
    throw InputError("", "", "attention mode '" + mode + "' is none of 'full', 'swin'");
  }
  if (window < 1 || shift < 0) {
    throw InputError("", "",
                     "attention in windows of " + std::to_string(window) + " voxels shifted by " +
                         std::to_string(shift) + ": the window must be at least 1, the shift at least 0");
  }
  scope.windowed = true;
  scope.window = window;
  scope.shift = shift;
  return scope;
}

SparseAttentionImpl::SparseAttentionImpl(const SparseAttentionOptions& options) : options_(options) {
  TORCH_CHECK(options.num_heads > 0 && options.channels > 0 && options.channels % options.num_heads == 0,
              "attention with ", options.channels, " channels cannot have ", options.num_heads, " heads");
  const std::int64_t channels = options.channels, head_channels = channels / options.num_heads;
  if (options.context_channels == 0) {
    to_qkv_ = register_module("to_qkv", nn::Linear(channels, 3 * channels, options.qkv_bias));
  } else {
    to_q_ = register_module("to_q", nn::Linear(channels, channels, options.qkv_bias));
    to_kv_ = register_module("to_kv", nn::Linear(options.context_channels, 2 * channels, options.qkv_bias));
  }
  if (options.qk_rms_norm) {
    q_rms_norm_ = register_module("q_rms_norm", nn::MultiHeadRmsNorm(head_channels, options.num_heads));
    k_rms_norm_ = register_module("k_rms_norm", nn::MultiHeadRmsNorm(head_channels, options.num_heads));
  }
  to_out_ = register_module("to_out", nn::Linear(channels, channels));
}

void SparseAttentionImpl::check_input(const SparseTensor& x, bool cross) const {
  TORCH_CHECK(x.feats.dim() == 2 && x.feats.size(1) == options_.channels && x.feats.size(0) == x.support->size(),
              "sparse attention over ", options_.channels, " channels at ", x.support->size(), " voxels: input ",
              x.feats.sizes());
  TORCH_CHECK(cross == to_qkv_.is_empty(),
              "sparse attention: ", cross ? "self attention was given a context" : "cross attention needs a context");
}

SparseTensor SparseAttentionImpl::forward(const SparseTensor& x) {
  check_input(x, /*cross=*/false);
  const auto attend_rows = [&](const Tensor& rows, const Tensor& offsets) {
    const std::vector<Tensor> qkv = row_heads(to_qkv_->forward(rows), 3, options_.num_heads);
    return attend_heads(qkv[0], qkv[1], qkv[2], offsets, offsets);
  };
  if (!options_.scope.windowed) {
    return x.with(to_out_->forward(attend_rows(x.feats, x.support->items().row_offsets())));
  }
  // Projections treat rows alike, so the narrow rows are sorted, not the three wider results.
  const WindowOrder& windows = x.support->windows(options_.scope.window, options_.scope.shift);
  const Tensor mixed = attend_rows(to_window_order(x.feats, windows), windows.offsets);
  return x.with(to_out_->forward(from_window_order(mixed, windows)));
}

SparseTensor SparseAttentionImpl::forward(const SparseTensor& x, const SparseTensor& context) {
  check_input(x, /*cross=*/true);
  TORCH_CHECK(context.feats.dim() == 2 && context.feats.size(1) == options_.context_channels &&
                  context.feats.size(0) == context.support->size(),
              "sparse cross attention to contexts of ", options_.context_channels, " channels at ",
              context.support->size(), " voxels: context ", context.feats.sizes());
  TORCH_CHECK(x.support->items().items() == context.support->items().items(), "sparse cross attention of ",
              x.support->items().items(), " items to ", context.support->items().items(), " contexts");
  if (!options_.scope.windowed) {
    return x.with(to_out_->forward(attend(to_q_->forward(x.feats), to_kv_->forward(context.feats),
                                          x.support->items().row_offsets(), context.support->items().row_offsets())));
  }
  const WindowOrder& queries = x.support->windows(options_.scope.window, options_.scope.shift);
  const WindowOrder& keys = context.support->windows(options_.scope.window, options_.scope.shift);
  const PairedOffsets offsets = pair_windows(queries, keys);
  const Tensor mixed = attend(to_q_->forward(to_window_order(x.feats, queries)),
                              to_kv_->forward(to_window_order(context.feats, keys)), offsets.queries, offsets.keys);
  return x.with(to_out_->forward(from_window_order(mixed, queries)));
}

SparseTensor SparseAttentionImpl::forward_dense(const SparseTensor& x, const Tensor& context) {
  check_input(x, /*cross=*/true);
  TORCH_CHECK(!options_.scope.windowed, "attention to a dense context cannot be windowed: it has no places");
  TORCH_CHECK(context.dim() == 3 && context.size(0) == x.support->items().items() &&
                  context.size(2) == options_.context_channels,
              "cross attention of ", x.support->items().items(), " items to contexts of ", options_.context_channels,
              " channels: context ", context.sizes());
  const std::int64_t items = context.size(0), tokens = context.size(1);
  const Tensor offsets = torch::arange(items + 1, torch::TensorOptions().dtype(torch::kInt64)) * tokens;
  const Tensor keys_values = nn::projected_context(this, context, [&]() -> std::vector<Tensor> {
    return {to_kv_->forward(context.reshape({items * tokens, context.size(2)}))};
  })[0];
  return x.with(
      to_out_->forward(attend(to_q_->forward(x.feats), keys_values, x.support->items().row_offsets(), offsets)));
}

Tensor SparseAttentionImpl::attend(const Tensor& queries, const Tensor& keys_values, const Tensor& q_offsets,
                                   const Tensor& k_offsets) {
  const std::vector<Tensor> kv = row_heads(keys_values, 2, options_.num_heads);
  return attend_heads(row_heads(queries, 1, options_.num_heads)[0], kv[0], kv[1], q_offsets, k_offsets);
}

Tensor SparseAttentionImpl::attend_heads(Tensor q, Tensor k, const Tensor& v, const Tensor& q_offsets,
                                         const Tensor& k_offsets) {
  if (!q_rms_norm_.is_empty()) {
    q = q_rms_norm_->forward(q);
    k = k_rms_norm_->forward(k);
  }
  return nn::ragged_attention(q, k, v, q_offsets, k_offsets).reshape({q.size(0), options_.channels});
}

}  // namespace anigen::sparse
