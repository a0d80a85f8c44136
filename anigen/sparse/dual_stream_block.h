#pragma once
#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/nn/modulated_block.h"
#include "anigen/sparse/attention.h"

namespace anigen::sparse {

struct DualStreamBlockOptions {
  std::int64_t channels = 0, channels_skl = 0;
  std::int64_t num_heads = 1, num_heads_skl = 1;
  std::int64_t context_channels = 0;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
  bool qk_rms_norm = false;        ///< of the attentions between the streams
  bool qk_rms_norm_cross = false;  ///< of those to the context
  bool share_mod = false;          ///< forward() is given the six chunks [B, 6C]; no `adaLN_modulation*`
};

/// Modulated block of a shape and a skeleton stream that attend to each other instead of to themselves (reference
/// flows-and-pipeline.md, 3.7, the dual-stream block; README-ops.md, ops_sparse_modulated_blocks). With h = LN(x)(1 +
/// scale) + shift of both streams: a = attn(h, h_skl), a_skl = attn_skl(h_skl, a), both gated and added; then ungated
/// cross attention of LN(x; affine) to a dense context; then the modulated MLP. Keys `norm2.*`, `attn.*`,
/// `context_cross_attn.*`, `mlp.mlp.{0,2}.*`, `adaLN_modulation.1.*`, and each with the suffix `_skl`.
class DualStreamBlockImpl : public torch::nn::Module {
 public:
  explicit DualStreamBlockImpl(const DualStreamBlockOptions& options);
  struct Output {
    SparseTensor x, x_skl;
  };
  /// @param mod [B, C] and mod_skl [B, C_skl], or [B, 6C] and [B, 6C_skl] with share_mod @param context [B, M, K]
  Output forward(const SparseTensor& x, const SparseTensor& x_skl, const Tensor& mod, const Tensor& mod_skl,
                 const Tensor& context);
  /// The linear layers of `adaLN_modulation` and `adaLN_modulation_skl`, which models initialise to zero; null with
  /// share_mod.
  nn::Linear modulation() const;
  nn::Linear modulation_skl() const;
  torch::Dtype dtype() const { return attention_->dtype(); }

 private:
  nn::AffineLayerNorm norm2_ = nullptr, norm2_skl_ = nullptr;
  SparseAttention attention_ = nullptr, attention_skl_ = nullptr;
  SparseAttention context_attention_ = nullptr, context_attention_skl_ = nullptr;
  nn::FeedForward mlp_ = nullptr, mlp_skl_ = nullptr;
  nn::Modulation modulation_ = nullptr, modulation_skl_ = nullptr;
};
TORCH_MODULE(DualStreamBlock);

}  // namespace anigen::sparse
