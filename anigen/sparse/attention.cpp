#include "anigen/sparse/attention.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/sparse/windows.h"

namespace anigen::sparse {

AttentionScope AttentionScope::of(const std::string& mode, std::int64_t window, std::int64_t shift) {
  AttentionScope scope;
  if (mode == "full") return scope;
  for (const char* curve : {"serialized", "shift_window", "shift_sequence", "shift_order"}) {
    if (mode == curve)
      throw NotSupportedError("", "", "serialized attention (mode '" + mode + "'); use 'swin' or 'full'");
  }
  if (mode != "swin" && mode != "windowed")
    throw InputError("", "", "attention mode '" + mode + "' is none of 'full', 'swin'");
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

SparseAttentionImpl::SparseAttentionImpl(const SparseAttentionOptions& options)
    : nn::RaggedAttentionImpl(options), scope_(options.scope) {}

void SparseAttentionImpl::check_input(const SparseTensor& x, bool cross) const {
  TORCH_CHECK(x.feats.dim() == 2 && x.feats.size(1) == attention_.channels && x.feats.size(0) == x.support->size(),
              "sparse attention over ", attention_.channels, " channels at ", x.support->size(), " voxels: input ",
              x.feats.sizes());
  TORCH_CHECK(cross == to_qkv_.is_empty(),
              "sparse attention: ", cross ? "self attention was given a context" : "cross attention needs a context");
}

SparseTensor SparseAttentionImpl::forward_in(const SparseTensor& x, const AttentionScope& scope) {
  check_input(x, /*cross=*/false);
  if (!scope.windowed) return x.with(nn::RaggedAttentionImpl::forward(x.feats, x.support->items()));
  // Projections treat rows alike, so the narrow rows are sorted, not the three wider results.
  const WindowOrder& windows = x.support->windows(scope.window, scope.shift);
  const Tensor mixed = attend_self(to_window_order(x.feats, windows), windows.offsets);
  return x.with(to_out_->forward(from_window_order(mixed, windows)));
}

SparseTensor SparseAttentionImpl::forward(const SparseTensor& x, const SparseTensor& context) {
  check_input(x, /*cross=*/true);
  TORCH_CHECK(context.feats.dim() == 2 && context.feats.size(1) == attention_.context_channels &&
                  context.feats.size(0) == context.support->size(),
              "sparse cross attention to contexts of ", attention_.context_channels, " channels at ",
              context.support->size(), " voxels: context ", context.feats.sizes());
  const nn::Ragged &items = x.support->items(), &contexts = context.support->items();
  if (!scope_.windowed) return x.with(nn::RaggedAttentionImpl::forward(x.feats, items, context.feats, contexts));
  TORCH_CHECK(items.items() == contexts.items(), "sparse cross attention of ", items.items(), " items to ",
              contexts.items(), " contexts");
  const WindowOrder& queries = x.support->windows(scope_.window, scope_.shift);
  const WindowOrder& keys = context.support->windows(scope_.window, scope_.shift);
  const PairedOffsets offsets = pair_windows(queries, keys);
  const Tensor mixed =
      attend_cross(to_q_->forward(to_window_order(x.feats, queries)),
                   to_kv_->forward(to_window_order(context.feats, keys)), offsets.queries, offsets.keys);
  return x.with(to_out_->forward(from_window_order(mixed, queries)));
}

SparseTensor SparseAttentionImpl::forward_dense(const SparseTensor& x, const Tensor& context) {
  check_input(x, /*cross=*/true);
  TORCH_CHECK(!scope_.windowed, "attention to a dense context cannot be windowed: it has no places");
  TORCH_CHECK(context.dim() == 3 && context.size(0) == x.support->items().items() &&
                  context.size(2) == attention_.context_channels,
              "cross attention of ", x.support->items().items(), " items to contexts of ", attention_.context_channels,
              " channels: context ", context.sizes());
  const std::int64_t items = context.size(0), tokens = context.size(1);
  const Tensor offsets = torch::arange(items + 1, torch::TensorOptions().dtype(torch::kInt64)) * tokens;
  const Tensor keys_values = nn::projected_context(this, context, [&]() -> std::vector<Tensor> {
    return {to_kv_->forward(context.reshape({items * tokens, context.size(2)}))};
  })[0];
  return x.with(
      to_out_->forward(attend_cross(to_q_->forward(x.feats), keys_values, x.support->items().row_offsets(), offsets)));
}

}  // namespace anigen::sparse
