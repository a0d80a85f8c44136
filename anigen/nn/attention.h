#pragma once
#include <vector>

#include "anigen/nn/attention_windows.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// softmax(q kᵀ / √D) v, a block of queries at a time, so that scores of N x M are never held whole, forward or
/// backward; the backward pass forms them again from the saved log-sum-exp of each row. Softmax in fp32. Can be
/// differentiated once; a second time is an error. On a CPU the same number of threads gives the same bits, and another
/// number may round sums otherwise. On a CPU 16-bit inputs are multiplied in fp32; with AVX512-BF16 the forward pass
/// multiplies bf16 as it is, adds up in fp32 and rounds the weights of the softmax to bf16. A row with scores that are
/// not finite becomes NaN. On a GPU the fused attention of LibTorch 2 is used.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], dtype of q @return [B, H, N, D], dtype of q
Tensor blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v);

/// Most bytes a thread of the CPU version allocates beside tensors of the sizes of q, k, v and the result (in fp32), in
/// the forward or the backward pass: two blocks of scores, at most 0.5 MiB, or one and a block of the result.
/// @param queries, keys N and M @param head_channels D
std::int64_t blocked_attention_scratch_bytes(std::int64_t queries, std::int64_t keys, std::int64_t head_channels);

/// blocked_attention by LibTorch's operations alone, for any device and dtype: `rows` queries of every head at a time.
Tensor tensor_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t rows);

/// softmax(q kᵀ / sqrt(d) + mask) v; the softmax of 16-bit scores is formed in fp32.
/// @param q [..., N, d] @param k, v [..., M, d] @param mask broadcast over [..., N, M]; undefined for none
Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask = {});

struct AttentionOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;         ///< divides channels
  std::int64_t context_channels = 0;  ///< above 0: cross attention to a context of this width
  bool qkv_bias = true;               ///< the output projection always has one
  bool qk_rms_norm = false;           ///< queries and keys through MultiHeadRmsNorm
  bool x_is_query = false;            ///< dense cross attention without `to_q`: the input is the query
  Lora lora_qkv, lora_out;            ///< of to_qkv (or to_q and to_kv), and of to_out
};

/// Layers of multi-head attention. Keys: self `to_qkv.*` (rows q, k, v; head j owns channels j·C/h … of each); cross
/// `to_q.*`, `to_kv.*` (k first); with qk_rms_norm `q_rms_norm.gamma`, `k_rms_norm.gamma`; `to_out.*`.
class AttentionLayers : public torch::nn::Module {
 public:
  torch::Dtype dtype() const { return dtype_of(to_out_->weight); }

 protected:
  explicit AttentionLayers(const AttentionOptions& options);
  /// [..., parts · C] → views [..., H, D] of the parts.
  std::vector<Tensor> heads_of(const Tensor& x, std::int64_t parts) const;

  AttentionOptions attention_;
  Linear to_qkv_ = nullptr, to_q_ = nullptr, to_kv_ = nullptr, to_out_ = nullptr;
  MultiHeadRmsNorm q_rms_norm_ = nullptr, k_rms_norm_ = nullptr;
};

/// Multi-head attention over dense batches (docs/reference/flows.md, 1.4 and 3.2).
class DenseAttentionImpl : public AttentionLayers {
 public:
  explicit DenseAttentionImpl(const AttentionOptions& options) : AttentionLayers(options) {}
  /// @param x [B, N, C] @param context [B, M, K] for cross attention, undefined for self attention @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& context = {});
  /// Self attention of tokens on a grid, inside windows. @param x [B, side³, C] @return [B, side³, C]
  Tensor forward_in_windows(const Tensor& x, const GridWindows& windows);

 private:
  std::vector<Tensor> self_heads(const Tensor& x);             // queries, keys, values [B, N, H, D], normed
  std::vector<Tensor> keys_and_values(const Tensor& context);  // [B, M, H, D] both; see ConditionCache
};
TORCH_MODULE(DenseAttention);

/// Multi-head attention inside each item of a ragged batch (docs/reference/autoencoders.md, 1.2, and 1.2).
class RaggedAttentionImpl : public AttentionLayers {
 public:
  explicit RaggedAttentionImpl(const AttentionOptions& options) : AttentionLayers(options) {}
  /// @param x [ΣN, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items);
  /// Every row of an item attends to the context rows of that item.
  /// @param x [ΣN, C] @param context [ΣM, context_channels], as many items as x @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items, const Tensor& context, const Ragged& context_items);

 protected:
  /// Before `to_out`; rows of a sequence together. @param x [N, C] @param offsets [S + 1] int64, CPU
  Tensor attend_self(const Tensor& x, const Tensor& offsets);
  /// @param queries [N, C], keys_values [M, 2C] as projected
  Tensor attend_cross(const Tensor& queries, const Tensor& keys_values, const Tensor& q_offsets,
                      const Tensor& k_offsets);

 private:
  Tensor attend_heads(Tensor q, Tensor k, const Tensor& v, const Tensor& q_offsets, const Tensor& k_offsets);
};
TORCH_MODULE(RaggedAttention);

}  // namespace anigen::nn
