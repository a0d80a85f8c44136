#pragma once
#include <vector>

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

struct DenseAttentionOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;         ///< divides channels
  std::int64_t context_channels = 0;  ///< above 0: cross attention to a context of this width
  bool qkv_bias = true;               ///< the output projection always has one
  bool qk_rms_norm = false;           ///< queries and keys through MultiHeadRmsNorm
  bool x_is_query = false;            ///< cross attention without `to_q`: the input is the query
  Lora lora_qkv, lora_out;            ///< of to_qkv (or to_q and to_kv), and of to_out
};

/// Multi-head attention over dense batches (reference flows-and-pipeline.md, 1.5 and 3.8). Keys: self `to_qkv.*`
/// (rows q, k, v); cross `to_q.*`, `to_kv.*` (k first); `to_out.*`; with qk_rms_norm `q_rms_norm.gamma`,
/// `k_rms_norm.gamma`.
class DenseAttentionImpl : public torch::nn::Module {
 public:
  explicit DenseAttentionImpl(const DenseAttentionOptions& options);
  /// @param x [B, N, C] @param context [B, M, K] for cross attention, undefined for self attention @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& context = {});
  torch::Dtype dtype() const { return dtype_of(to_out_->weight); }

 private:
  std::vector<Tensor> keys_and_values(const Tensor& context);  // [B, M, H, D] both; see KeptContexts

  std::int64_t num_heads_, channels_;
  Linear to_qkv_ = nullptr, to_q_ = nullptr, to_kv_ = nullptr, to_out_ = nullptr;
  MultiHeadRmsNorm q_rms_norm_ = nullptr, k_rms_norm_ = nullptr;
};
TORCH_MODULE(DenseAttention);

/// softmax(q kᵀ / sqrt(d) + mask) v; the softmax of 16-bit scores is formed in fp32.
/// @param q [..., N, d] @param k, v [..., M, d] @param mask broadcast over [..., N, M]; undefined for none
Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask = {});

struct AttentionOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;         ///< divides channels
  std::int64_t context_channels = 0;  ///< width of the context of cross attention; 0: channels
  bool qkv_bias = true;               ///< the output projection always has one
};

/// Full attention inside each item of a ragged batch (reference autoencoders.md, 0.2, MHSA). Keys `to_qkv.*` (rows
/// q, k, v; head j owns channels j·C/h … of each) and `to_out.*`.
class SelfAttentionImpl : public torch::nn::Module {
 public:
  explicit SelfAttentionImpl(const AttentionOptions& options);
  /// @param x [ΣN, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items);
  torch::Dtype dtype() const { return dtype_of(to_qkv_->weight); }

 private:
  std::int64_t num_heads_;
  Linear to_qkv_ = nullptr, to_out_ = nullptr;
};
TORCH_MODULE(SelfAttention);

/// Every row of an item attends to the context rows of the same item (reference autoencoders.md, 1.2). Keys
/// `to_q.*`, `to_kv.*` (k first), `to_out.*`.
class CrossAttentionImpl : public torch::nn::Module {
 public:
  explicit CrossAttentionImpl(const AttentionOptions& options);
  /// @param x [ΣN, C] @param context [ΣM, context_channels], as many items as x @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items, const Tensor& context, const Ragged& context_items);

 private:
  std::int64_t num_heads_;
  Linear to_q_ = nullptr, to_kv_ = nullptr, to_out_ = nullptr;
};
TORCH_MODULE(CrossAttention);

}  // namespace anigen::nn
