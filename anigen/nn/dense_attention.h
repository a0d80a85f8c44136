#pragma once
#include <vector>

#include "anigen/nn/linear.h"
#include "anigen/nn/rms_norm.h"

namespace anigen::nn {

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

}  // namespace anigen::nn
