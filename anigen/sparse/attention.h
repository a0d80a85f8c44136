#pragma once
#include <string>
#include <vector>

#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
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

struct SparseAttentionOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;         ///< divides channels
  std::int64_t context_channels = 0;  ///< above 0: cross attention
  AttentionScope scope;
  bool qkv_bias = true;      ///< the output projection always has one
  bool qk_rms_norm = false;  ///< queries and keys through nn::MultiHeadRmsNorm
};

/// Multi-head attention over sparse tensors (reference flows-and-pipeline.md, 3.6). Keys as nn::DenseAttention:
/// `to_qkv.*`, or `to_q.*` and `to_kv.*`; `to_out.*`; `{q,k}_rms_norm.gamma`. Windowed cross attention pairs windows of
/// query and context by published number (WindowOrder::windows; reference README-ops.md, "Sparse operators"): a query
/// without keys gives zeros before `to_out`.
class SparseAttentionImpl : public torch::nn::Module {
 public:
  explicit SparseAttentionImpl(const SparseAttentionOptions& options);
  SparseTensor forward(const SparseTensor& x);                               ///< self
  SparseTensor forward(const SparseTensor& x, const SparseTensor& context);  ///< cross, as many items as x
  /// Cross attention of every item to its own dense context; not windowed. @param context [B, M, K]
  SparseTensor forward_dense(const SparseTensor& x, const Tensor& context);
  torch::Dtype dtype() const { return nn::dtype_of(to_out_->weight); }

 private:
  void check_input(const SparseTensor& x, bool cross) const;
  /// @param queries [N, C] and keys [M, 2C] as projected, rows of a sequence together @return [N, C], before `to_out`
  Tensor attend(const Tensor& queries, const Tensor& keys_values, const Tensor& q_offsets, const Tensor& k_offsets);
  Tensor attend_heads(Tensor q, Tensor k, const Tensor& v, const Tensor& q_offsets, const Tensor& k_offsets);

  SparseAttentionOptions options_;
  nn::Linear to_qkv_ = nullptr, to_q_ = nullptr, to_kv_ = nullptr, to_out_ = nullptr;
  nn::MultiHeadRmsNorm q_rms_norm_ = nullptr, k_rms_norm_ = nullptr;
};
TORCH_MODULE(SparseAttention);

}  // namespace anigen::sparse
