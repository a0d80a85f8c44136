#pragma once
#include "anigen/nn/linear.h"
#include "anigen/nn/ragged.h"

namespace anigen::nn {

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
