#pragma once
#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/nn/modulated_block.h"
#include "anigen/sparse/attention.h"

namespace anigen::sparse {

struct SparseModulatedBlockOptions {
  std::int64_t channels = 0;
  std::int64_t context_channels = 0;  ///< of the cross block
  std::int64_t num_heads = 1;
  double mlp_ratio = 4.0;
  AttentionScope scope;  ///< of the self attention; cross attention is always full
  bool qkv_bias = true;
  bool qk_rms_norm = false, qk_rms_norm_cross = false;
  bool share_mod = false;     ///< forward() is given the six chunks [B, 6C]; no `adaLN_modulation`
  bool context_norm = false;  ///< affine layer norm of the context (key `context_norm.*`)
};

/// nn::ModulatedBlock over sparse tensors: each item is modulated by its own row (reference
/// flows-and-pipeline.md, 3.7). Keys `attn.*`, `mlp.mlp.{0,2}.*`, `adaLN_modulation.1.*`.
class SparseModulatedBlockImpl : public torch::nn::Module {
 public:
  explicit SparseModulatedBlockImpl(const SparseModulatedBlockOptions& options);
  /// @param mod [B, C], or [B, 6C] with share_mod
  SparseTensor forward(const SparseTensor& x, const Tensor& mod);
  /// The linear layer of `adaLN_modulation`, which models initialise to zero; null with share_mod.
  nn::Linear modulation() const;
  torch::Dtype dtype() const { return attention_->dtype(); }

 private:
  SparseAttention attention_ = nullptr;
  nn::FeedForward mlp_ = nullptr;
  nn::Modulation modulation_ = nullptr;
};
TORCH_MODULE(SparseModulatedBlock);

/// nn::ModulatedCrossBlock over sparse tensors: the block of the structured-latent flow, with context_norm (reference
/// flows-and-pipeline.md, 2.4). Keys `norm2.*`, `context_norm.*`, `self_attn.*`, `cross_attn.*`, `mlp.mlp.{0,2}.*`,
/// `adaLN_modulation.1.*`.
class SparseModulatedCrossBlockImpl : public torch::nn::Module {
 public:
  explicit SparseModulatedCrossBlockImpl(const SparseModulatedBlockOptions& options);
  /// @param mod [B, C], or [B, 6C] with share_mod @param context as many items as x
  SparseTensor forward(const SparseTensor& x, const Tensor& mod, const SparseTensor& context);
  /// @param context [B, M, K]
  SparseTensor forward_dense(const SparseTensor& x, const Tensor& mod, const Tensor& context);
  nn::Linear modulation() const;  ///< as SparseModulatedBlock
  torch::Dtype dtype() const { return self_attention_->dtype(); }

 private:
  template <typename Cross>
  SparseTensor forward_with(const SparseTensor& x, const Tensor& mod, const Cross& cross);
  Tensor normed_context(const Tensor& context);

  nn::AffineLayerNorm norm2_ = nullptr, context_norm_ = nullptr;
  SparseAttention self_attention_ = nullptr, cross_attention_ = nullptr;
  nn::FeedForward mlp_ = nullptr;
  nn::Modulation modulation_ = nullptr;
};
TORCH_MODULE(SparseModulatedCrossBlock);

}  // namespace anigen::sparse
