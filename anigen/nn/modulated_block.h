#pragma once
#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/dense_attention.h"
#include "anigen/nn/feed_forward.h"

namespace anigen::nn {

struct ModulatedBlockOptions {
  std::int64_t channels = 0;
  std::int64_t context_channels = 0;  ///< of the cross block
  std::int64_t num_heads = 1;
  double mlp_ratio = 4.0;
  bool qk_rms_norm = false, qk_rms_norm_cross = false;
  bool qkv_bias = true;
  bool share_mod = false;      ///< forward() is given the six chunks [B, 6C]; no `adaLN_modulation`
  bool context_norm = false;   ///< affine layer norm of the context (key `context_norm.*`)
  Lora lora_self, lora_cross;  ///< of every projection of the self and the cross attention
};

/// SiLU · Linear(C → 6C): shift, scale and gate of the attention, then of the MLP. Keys `1.*`. Models with share_mod
/// have one per stream, otherwise each block has its own. Residual blocks take other numbers of values from it.
class ModulationImpl : public torch::nn::Module {
 public:
  explicit ModulationImpl(std::int64_t channels) : ModulationImpl(channels, 6 * channels) {}
  ModulationImpl(std::int64_t channels, std::int64_t values);
  /// @param mod [B, C] @return [B, 6C], or [B, values]
  Tensor forward(const Tensor& mod);
  Linear linear = nullptr;
};
TORCH_MODULE(Modulation);

/// Dense block modulated by adaptive layer norm, with cross attention in the middle that is neither gated nor
/// modulated (reference flows-and-pipeline.md, 1.5, ten steps). Keys `norm2.*`, `self_attn.*`, `cross_attn.*`,
/// `mlp.mlp.{0,2}.*`, `adaLN_modulation.1.*`, `context_norm.*`.
class ModulatedCrossBlockImpl : public torch::nn::Module {
 public:
  explicit ModulatedCrossBlockImpl(const ModulatedBlockOptions& options);
  /// @param x [B, N, C] @param mod [B, C], or [B, 6C] with share_mod @param context [B, M, K] @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& mod, const Tensor& context);
  /// The linear layer of `adaLN_modulation`, which models initialise to zero; null with share_mod.
  Linear modulation() const;

 private:
  AffineLayerNorm norm2_ = nullptr, context_norm_ = nullptr;
  DenseAttention self_attention_ = nullptr, cross_attention_ = nullptr;
  FeedForward mlp_ = nullptr;
  Modulation modulation_ = nullptr;
};
TORCH_MODULE(ModulatedCrossBlock);

/// The same without cross attention. Keys `attn.*`, `mlp.mlp.{0,2}.*`, `adaLN_modulation.1.*`.
class ModulatedBlockImpl : public torch::nn::Module {
 public:
  explicit ModulatedBlockImpl(const ModulatedBlockOptions& options);
  /// @param x [B, N, C] @param mod [B, C], or [B, 6C] with share_mod @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& mod);
  /// The linear layer of `adaLN_modulation`, which models initialise to zero; null with share_mod.
  Linear modulation() const;

 private:
  DenseAttention attention_ = nullptr;
  FeedForward mlp_ = nullptr;
  Modulation modulation_ = nullptr;
};
TORCH_MODULE(ModulatedBlock);

}  // namespace anigen::nn
