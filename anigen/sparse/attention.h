#pragma once
#include <string>
#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// Scope of attention: "full" inside an item, or "swin" inside shifted windows.
struct AttentionScope {
  bool windowed = false;
  std::int64_t window = 8, shift = 0;

  /// @param mode "full", or "swin", which attention modules call "windowed" @param window edge in voxels, from 1
  /// @param shift added to the coordinates, from 0; both are ignored by "full"
  /// @throws NotSupportedError for the published modes that follow a curve through the voxels ("serialized", and
  /// "shift_window", "shift_sequence", "shift_order" of whole models), InputError otherwise
  static AttentionScope of(const std::string& mode, std::int64_t window, std::int64_t shift);
};

struct SparseAttentionOptions : nn::AttentionOptions {
  SparseAttentionOptions() = default;
  SparseAttentionOptions(const nn::AttentionOptions& options, const AttentionScope& where)
      : nn::AttentionOptions(options), scope(where) {}
  AttentionScope scope;
};

/// Multi-head attention over sparse tensors (docs/reference/flows.md, 3.1). Windowed cross attention pairs windows of
/// query and context by published number (WindowOrder::windows; docs/reference/flows.md, 3.1): a query without keys
/// gives zeros before `to_out`.
class SparseAttentionImpl : public nn::RaggedAttentionImpl {
 public:
  explicit SparseAttentionImpl(const SparseAttentionOptions& options);
  SparseTensor forward(const SparseTensor& x) { return forward_in(x, scope_); }  ///< self
  SparseTensor forward_in(const SparseTensor& x, const AttentionScope& scope);   ///< self, in another scope
  SparseTensor forward(const SparseTensor& x, const SparseTensor& context);      ///< cross, as many items as x
  /// Cross attention of every item to its own dense context; not windowed. @param context [B, M, K]
  SparseTensor forward_dense(const SparseTensor& x, const Tensor& context);

 private:
  void check_input(const SparseTensor& x, bool cross) const;

  AttentionScope scope_;
};
TORCH_MODULE(SparseAttention);

}  // namespace anigen::sparse
