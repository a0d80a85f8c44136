#pragma once
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>

#include "anigen/nn/attention.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"

namespace anigen::nn {

/// FFN(a→b; r): Linear(a→r·a) · gelu (tanh form) · Linear(r·a→b). Keys `mlp.0.*` and `mlp.2.*`
/// (docs/reference/autoencoders.md, 1.2). The hidden width follows the input width, not the output width.
class FeedForwardImpl : public torch::nn::Module {
 public:
  FeedForwardImpl(std::int64_t in_channels, std::int64_t out_channels, double mlp_ratio = 4.0);

  /// @param x [..., a] @return [..., b]
  Tensor forward(const Tensor& x) { return mlp_->forward(x); }
  torch::Dtype dtype() const { return mlp_->dtype(); }

 private:
  Mlp mlp_ = nullptr;
};
TORCH_MODULE(FeedForward);

/// Pre-norm block x += MHSA(LN(x)), x += FFN(LN(x)); norms in fp32, eps 1e-6, without parameters
/// (docs/reference/autoencoders.md, 1.2). Keys `attn.*` (or the given name) and `mlp.mlp.{0,2}.*`.
class TransformerBlockImpl : public torch::nn::Module {
 public:
  TransformerBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio = 4.0,
                       const std::string& attention_name = "attn");
  /// @param x [ΣN, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items);
  torch::Dtype dtype() const { return attention_->dtype(); }

 private:
  RaggedAttention attention_ = nullptr;
  FeedForward mlp_ = nullptr;
};
TORCH_MODULE(TransformerBlock);

/// Pre-norm block without self attention: x += CrossAttn(LN(x), context), x += FFN(LN(x)); the context is not
/// normalised (docs/reference/autoencoders.md, 2.2). Keys `cross_attn.*` and `mlp.mlp.{0,2}.*`.
class CrossBlockImpl : public torch::nn::Module {
 public:
  CrossBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio = 4.0);
  /// @param x [ΣN, C] @param context [ΣM, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items, const Tensor& context, const Ragged& context_items);

 private:
  RaggedAttention attention_ = nullptr;
  FeedForward mlp_ = nullptr;
};
TORCH_MODULE(CrossBlock);

/// Sizes and switches of every block with attention, dense or sparse.
struct BlockOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
  bool qk_rms_norm = false, qk_rms_norm_cross = false;
  Lora lora_self, lora_cross;  ///< of every projection of the self and the cross attention
};
AttentionOptions self_attention_of(const BlockOptions& options);
AttentionOptions cross_attention_of(const BlockOptions& options, std::int64_t context_channels);

struct ModulatedBlockOptions : BlockOptions {
  std::int64_t context_channels = 0;  ///< of the cross block
  bool share_mod = false;             ///< forward() is given the six chunks [B, 6C]; no `adaLN_modulation`
  bool context_norm = false;          ///< affine layer norm of the context (key `context_norm.*`)
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

/// Adaptive layer norm of one half of a block: a row of shift, scale and gate per item.
struct RowModulation {
  Ragged items;               ///< of the rows of x, one after another
  Tensor shift, scale, gate;  ///< [B, C]; without a gate only modulate() can be used

  /// LN(x) (1 + scale) + shift, eps 1e-6. @param x [N, C], or [B, N, C] with items of one length
  Tensor modulate(const Tensor& x) const;
  /// x + gate · result, both as above.
  Tensor add_gated(const Tensor& x, const Tensor& result) const;
};

/// Those of the attention and of the MLP (chunks: shift, scale, gate of one, then of the other;
/// docs/reference/flows.md, 1.4).
/// @param layer of a block with a modulation of its own, else null @param mod [B, C], or without a layer [B, 6C]
/// @param x [..., C] rows of the items
std::pair<RowModulation, RowModulation> row_modulations(Modulation& layer, const Tensor& mod, const Ragged& items,
                                                        const Tensor& x);

/// Layers and body of the blocks modulated by adaptive layer norm, over dense batches or sparse tensors.
/// Keys `norm2.*`, `context_norm.*`, `self_attn.*`, `cross_attn.*`, `mlp.mlp.{0,2}.*`, `adaLN_modulation.1.*`; without
/// cross attention `attn.*`, `mlp.mlp.*` and `adaLN_modulation.1.*` alone.
template <typename Attention>
class ModulatedLayers : public torch::nn::Module {
 public:
  /// The linear layer of `adaLN_modulation`, which models initialise to zero; null with share_mod.
  Linear modulation() const { return modulation_.is_empty() ? Linear(nullptr) : modulation_->linear; }
  torch::Dtype dtype() const { return self_attention_->dtype(); }

 protected:
  /// @param cross null: a block without cross attention
  ModulatedLayers(const ModulatedBlockOptions& options, const Attention& self, const Attention& cross) {
    if (!cross.is_empty()) {
      norm2_ = register_module("norm2", AffineLayerNorm(options.channels, kBlockNormEps));
      if (options.context_norm)
        context_norm_ = register_module("context_norm", AffineLayerNorm(options.context_channels, kBlockNormEps));
    }
    self_attention_ = register_module(cross.is_empty() ? "attn" : "self_attn", self);
    if (!cross.is_empty()) cross_attention_ = register_module("cross_attn", cross);
    mlp_ = register_module("mlp", FeedForward(options.channels, options.channels, options.mlp_ratio));
    if (!options.share_mod) modulation_ = register_module("adaLN_modulation", Modulation(options.channels));
  }

  /// The ten steps of docs/reference/flows.md, 1.4: gated attention, cross attention that is neither gated nor
  /// modulated, gated MLP. @param attend, cross attention of rows that were normed; cross null: none
  template <typename Attend, typename Cross>
  Tensor run(const Tensor& x, const Ragged& items, const Tensor& mod, const Attend& attend, const Cross& cross) {
    const auto [attention, mlp] = row_modulations(modulation_, mod, items, x);
    Tensor h = attention.add_gated(x, attend(attention.modulate(x)));
    if constexpr (!std::is_same_v<Cross, std::nullptr_t>) h = h + cross(norm2_->forward(h));
    return mlp.add_gated(h, mlp_->forward(mlp.modulate(h)));
  }
  Tensor normed_context(const Tensor& context) {
    return context_norm_.is_empty() ? context : context_norm_->forward(context);
  }

  AffineLayerNorm norm2_ = nullptr, context_norm_ = nullptr;
  Attention self_attention_ = nullptr, cross_attention_ = nullptr;
  FeedForward mlp_ = nullptr;
  Modulation modulation_ = nullptr;
};

/// Dense block modulated by adaptive layer norm, with cross attention in the middle.
class ModulatedCrossBlockImpl : public ModulatedLayers<DenseAttention> {
 public:
  explicit ModulatedCrossBlockImpl(const ModulatedBlockOptions& options);
  /// @param x [B, N, C] @param mod [B, C], or [B, 6C] with share_mod @param context [B, M, K]
  /// @param windows of the self attention, by default full @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& mod, const Tensor& context, const GridWindows& windows = {});
};
TORCH_MODULE(ModulatedCrossBlock);

/// As above, without cross attention.
class ModulatedBlockImpl : public ModulatedLayers<DenseAttention> {
 public:
  explicit ModulatedBlockImpl(const ModulatedBlockOptions& options);
  /// @param x [B, N, C] @param mod [B, C], or [B, 6C] with share_mod @return [B, N, C]
  Tensor forward(const Tensor& x, const Tensor& mod);
};
TORCH_MODULE(ModulatedBlock);

/// Published initial values of what the streams of both flows have: time embedders N(0, 0.02²), modulation and last
/// layer zero (docs/reference/flows.md, 1.6).
template <typename Stream>
void initialize_modulated_stream(Stream& stream) {
  normal_linear(*stream.t_embedder->first);
  normal_linear(*stream.t_embedder->second);
  if (!stream.shared_modulation.is_empty()) zero_parameters(*stream.shared_modulation);
  for (const auto& block : stream.blocks) {
    const Linear modulation = block->modulation();
    if (!modulation.is_empty()) zero_parameters(*modulation.ptr());
  }
  zero_parameters(*stream.out_layer);
}

struct DenseBlockOptions : BlockOptions {
  std::int64_t out_channels = 0;      ///< 0: channels; another width sends the last residual through `res_mlp`
  std::int64_t context_channels = 0;  ///< of the cross block
  bool affine_norms = false;          ///< layer norms with parameters (keys `norm{1,2,3}.*`)
  bool self_attention = true;         ///< false: a cross block without its first step (published as no_self)
};

/// Layer norm with eps 1e-6 that has parameters or not, as an option of the block says.
class BlockNorm {
 public:
  BlockNorm() = default;
  /// Registers an AffineLayerNorm under this name in the block when affine.
  BlockNorm(torch::nn::Module& block, const char* name, std::int64_t channels, bool affine);
  Tensor operator()(const Tensor& x);

 private:
  AffineLayerNorm affine_ = nullptr;
};

/// The last step of a pre-norm block: x, or res_mlp(x) when the width changes, + mlp(LN(x)). Keys `<mlp>.mlp.{0,2}.*`
/// and `res_<mlp>.mlp.{0,2}.*`, the latter with hidden width C.
class BlockOutput {
 public:
  BlockOutput() = default;
  BlockOutput(torch::nn::Module& block, const std::string& mlp, const DenseBlockOptions& options);
  /// @param x the residual @param normed what the MLP sees @return [..., out_channels]
  Tensor operator()(const Tensor& x, const Tensor& normed);

 private:
  FeedForward mlp_ = nullptr, residual_ = nullptr;
};

/// Pre-norm block over a dense batch: x += attn(LN(x)), then BlockOutput (docs/reference/flows.md, 3.2). Keys
/// `norm{1,2}.*` if affine, `attn.*`, `mlp.mlp.*`, `res_mlp.mlp.*` if the width changes.
class DenseBlockImpl : public torch::nn::Module {
 public:
  explicit DenseBlockImpl(const DenseBlockOptions& options);
  /// @param x [B, N, C] @return [B, N, out_channels]
  Tensor forward(const Tensor& x);

 private:
  BlockNorm norm1_, norm2_;
  DenseAttention attention_ = nullptr;
  BlockOutput output_;
};
TORCH_MODULE(DenseBlock);

/// x += self(LN1(x)), x += cross(LN2(x), context), then BlockOutput with LN3; the context is not normalised
/// (docs/reference/flows.md, 3.2). Keys `norm{1,2,3}.*` if affine, `self_attn.*`, `cross_attn.*`, `mlp.mlp.*`,
/// `res_mlp.mlp.*`.
class DenseCrossBlockImpl : public torch::nn::Module {
 public:
  explicit DenseCrossBlockImpl(const DenseBlockOptions& options);
  /// @param x [B, N, C] @param context [B, M, K] @return [B, N, out_channels]
  Tensor forward(const Tensor& x, const Tensor& context);

 private:
  BlockNorm norm1_, norm2_, norm3_;
  DenseAttention self_attention_ = nullptr, cross_attention_ = nullptr;
  BlockOutput output_;
};
TORCH_MODULE(DenseCrossBlock);

/// Vertices take up the joints' features by their skin weights, joints attend to each other (docs/reference/flows.md,
/// 3.2): x ← x + skin · to_v(LN1 j), then BlockOutput with LN2; u = j + attn(LN3 j), then j ← (j or res_joint_mlp(j)) +
/// joint_mlp(u) without a norm. Keys `norm{1,2,3}.*` if affine, `joint_attn.*`, `to_v.*`, `mlp.mlp.*`,
/// `joint_mlp.mlp.*`, `res_mlp.mlp.*`, `res_joint_mlp.mlp.*`.
class SkinCrossBlockImpl : public torch::nn::Module {
 public:
  explicit SkinCrossBlockImpl(const DenseBlockOptions& options);
  struct Output {
    Tensor vertices;  ///< [B, V, out_channels]
    Tensor joints;    ///< [B, J, out_channels]
  };
  /// @param vertices [B, V, C] @param joints [B, J, C] @param skin [B, V, J]
  Output forward(const Tensor& vertices, const Tensor& joints, const Tensor& skin);

 private:
  BlockNorm norm1_, norm2_, norm3_;
  DenseAttention attention_ = nullptr;
  Linear to_values_ = nullptr;
  BlockOutput output_, joint_output_;
};
TORCH_MODULE(SkinCrossBlock);

}  // namespace anigen::nn
