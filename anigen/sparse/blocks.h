#pragma once
#include <string>
#include <vector>

#include "anigen/nn/blocks.h"
#include "anigen/nn/norms.h"
#include "anigen/sparse/attention.h"
#include "anigen/sparse/convolution.h"
#include "anigen/sparse/norms.h"
#include "anigen/sparse/support.h"

namespace anigen::sparse {

struct SparseBlockOptions : nn::BlockOptions {
  AttentionScope scope;                        ///< of the self attention
  AttentionScope cross_scope;                  ///< of the cross attentions
  bool affine_norms = false;                   ///< parameters in norm1, norm2 (norm3 and norm4 of cross blocks)
  std::vector<std::int64_t> context_channels;  ///< of a multi-context block, one per context; of a cross block, its one
  bool norm_context = false;                   ///< of a cross block: norm4 of the context (published context_is_dual)
  std::string attention_name = "attn";         ///< key of the self attention of a SparseTransformerBlock
};

/// x += attn(LN(x)), x += mlp(LN(x)), eps 1e-6 (docs/reference/autoencoders.md, 1.2 and 4.1). Keys `norm{1,2}.*` with
/// affine_norms, `attn.*` (or the given name), `mlp.mlp.{0,2}.*`.
class SparseTransformerBlockImpl : public torch::nn::Module {
 public:
  explicit SparseTransformerBlockImpl(const SparseBlockOptions& options);
  SparseTensor forward(const SparseTensor& x);
  torch::Dtype dtype() const { return attention_->dtype(); }

 private:
  nn::BlockNorm norm1_, norm2_;
  SparseAttention attention_ = nullptr;
  nn::FeedForward mlp_ = nullptr;
};
TORCH_MODULE(SparseTransformerBlock);

/// x += self(LN1(x)), x += cross(LN2(x), context), x += mlp(LN3(x)), eps 1e-6; with norm_context the context passes LN4
/// (docs/reference/flows.md, 3.2). Keys `norm{1,2,3,4}.*` with affine_norms, `self_attn.*`, `cross_attn.*`,
/// `mlp.mlp.{0,2}.*`.
class SparseCrossBlockImpl : public torch::nn::Module {
 public:
  explicit SparseCrossBlockImpl(const SparseBlockOptions& options);
  SparseTensor forward(const SparseTensor& x, const SparseTensor& context);
  torch::Dtype dtype() const { return self_attention_->dtype(); }

 private:
  bool norm_context_;
  nn::BlockNorm norm1_, norm2_, norm3_, norm4_;
  SparseAttention self_attention_ = nullptr, cross_attention_ = nullptr;
  nn::FeedForward mlp_ = nullptr;
};
TORCH_MODULE(SparseCrossBlock);

/// Self attention, then g = LN(x) with affine `norm2` once and x += cross_attn_k(g, LN(context_k)) for each context in
/// order, then the MLP; eps 1e-6 (docs/reference/autoencoders.md, 4.1). Keys in this order: `norm2.*`, `self_attn.*`,
/// `cross_attn_{k}.*` and `ctx_norm_{k}.*` for each context, `mlp.mlp.*`; norm1 and norm3 have parameters only with
/// affine_norms. Without contexts there is no norm2: a SparseTransformerBlock whose attention is named `self_attn`.
class SparseMultiContextBlockImpl : public torch::nn::Module {
 public:
  explicit SparseMultiContextBlockImpl(const SparseBlockOptions& options);
  /// @param contexts one per entry of context_channels, each with as many items as x
  SparseTensor forward(const SparseTensor& x, const std::vector<SparseTensor>& contexts);
  torch::Dtype dtype() const { return self_attention_->dtype(); }

 private:
  nn::BlockNorm norm1_, norm2_, norm3_;
  SparseAttention self_attention_ = nullptr;
  std::vector<SparseAttention> cross_attentions_;
  std::vector<nn::AffineLayerNorm> context_norms_;
  nn::FeedForward mlp_ = nullptr;
};
TORCH_MODULE(SparseMultiContextBlock);

struct SparseModulatedBlockOptions : nn::ModulatedBlockOptions {
  AttentionScope scope;  ///< of the self attention; cross attention is always full
};

/// nn::ModulatedBlock over sparse tensors: each item is modulated by its own row (docs/reference/flows.md, 3.2).
class SparseModulatedBlockImpl : public nn::ModulatedLayers<SparseAttention> {
 public:
  explicit SparseModulatedBlockImpl(const SparseModulatedBlockOptions& options);
  /// @param mod [B, C], or [B, 6C] with share_mod
  SparseTensor forward(const SparseTensor& x, const Tensor& mod);
};
TORCH_MODULE(SparseModulatedBlock);

/// nn::ModulatedCrossBlock over sparse tensors: the block of the structured-latent flow, with context_norm
/// (docs/reference/flows.md, 2.3).
class SparseModulatedCrossBlockImpl : public nn::ModulatedLayers<SparseAttention> {
 public:
  explicit SparseModulatedCrossBlockImpl(const SparseModulatedBlockOptions& options);
  /// @param mod [B, C], or [B, 6C] with share_mod @param context as many items as x
  /// @param scope of the self attention in place of the block's own, when windowed
  SparseTensor forward(const SparseTensor& x, const Tensor& mod, const SparseTensor& context,
                       const AttentionScope& scope = {});
  /// @param context [B, M, K]
  SparseTensor forward_dense(const SparseTensor& x, const Tensor& mod, const Tensor& context,
                             const AttentionScope& scope = {});

 private:
  template <typename Cross>
  SparseTensor forward_with(const SparseTensor& x, const Tensor& mod, const AttentionScope& scope, const Cross& cross);
};
TORCH_MODULE(SparseModulatedCrossBlock);

/// The norm options: qk_rms_norm of the attentions between the streams, qk_rms_norm_cross of those to the context.
struct DualStreamBlockOptions : nn::BlockOptions {
  std::int64_t channels_skl = 0, num_heads_skl = 1;
  std::int64_t context_channels = 0;
  bool share_mod = false;  ///< forward() is given the six chunks [B, 6C]; no `adaLN_modulation*`
};

/// Modulated block of a shape and a skeleton stream that attend to each other instead of to themselves
/// (docs/reference/flows.md, 3.2; docs/reference/flows.md, 3.2). With h = LN(x)(1 + scale) + shift of both streams: a =
/// attn(h, h_skl), a_skl = attn_skl(h_skl, a), both gated and added; then ungated cross attention of LN(x; affine) to a
/// dense context; then the modulated MLP. Keys `norm2.*`, `attn.*`, `context_cross_attn.*`, `mlp.mlp.{0,2}.*`,
/// `adaLN_modulation.1.*`, and each with the suffix `_skl`.
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

struct ResidualBlockOptions {
  std::int64_t channels = 0, out_channels = 0;
  std::int64_t embedding_channels = 0;  ///< of the time embedding
};

/// Residual block of the structured-latent flow before and after its transformers (docs/reference/flows.md, 2.2): h =
/// conv1(SiLU(LN(x; affine))), h = conv2(SiLU(LN(h) (1 + scale) + shift)), plus x through a linear layer where the
/// width changes. Scale and shift come from the embedding, the scale first. Norms are over the channels of each voxel,
/// eps 1e-6. Keys `norm1.*`, `conv1.conv.*`, `conv2.conv.*`, `emb_layers.1.*`, `skip_connection.*`.
class ResidualBlockImpl : public torch::nn::Module {
 public:
  explicit ResidualBlockImpl(const ResidualBlockOptions& options);
  /// @param x [N, channels], for a block that lowers the resolution already down-sampled
  /// @param embedding [B, embedding_channels], one row per item @return [N, out_channels]
  SparseTensor forward(const SparseTensor& x, const Tensor& embedding);
  /// forward() of `x` up-sampled to `fine`. What comes before the first convolution and in the skip treats every voxel
  /// alone, so it is done before the rows are repeated.
  /// @param x on fine->coarsened(2).support @return on fine
  SparseTensor forward_up(const SparseTensor& x, const SupportPtr& fine, const Tensor& embedding);
  void initialize();  ///< the last convolution to zero; call after default_submanifold_kernels

 private:
  Tensor skipped(const Tensor& rows);
  SparseTensor finish(const SparseTensor& h, const Tensor& skip, const Tensor& embedding);

  nn::AffineLayerNorm norm1_ = nullptr;
  SubmanifoldConv3d conv1_ = nullptr, conv2_ = nullptr;
  nn::Modulation modulation_ = nullptr;
  nn::Linear skip_ = nullptr;
};
TORCH_MODULE(ResidualBlock);

struct SubdivideBlockOptions {
  std::int64_t channels = 0, out_channels = 0;
  bool subdivide = true;          ///< false: the residual block of the skin U-Net
  bool skip_convolution = false;  ///< a 1³ convolution on the skip even when the width stays
  std::int64_t groups = 32;
};

/// Up-sampling block of the decoder (docs/reference/autoencoders.md, 4.6): norm and SiLU, subdivision of both branches,
/// two convolutions with a norm between, plus the skip. Keys `act_layers.0.*`, `out_layers.0.conv.*`, `out_layers.1.*`,
/// `out_layers.3.conv.*`, `skip_connection.conv.*`.
class SubdivideBlockImpl : public torch::nn::Module {
 public:
  explicit SubdivideBlockImpl(const SubdivideBlockOptions& options);
  SparseTensor forward(const SparseTensor& x);
  void initialize();           ///< the last convolution to zero; call after default_submanifold_kernels
  torch::Dtype dtype() const;  ///< of the convolutions

 private:
  SubdivideBlockOptions options_;
  SparseGroupNorm norm1_ = nullptr, norm2_ = nullptr;
  SubmanifoldConv3d conv1_ = nullptr, conv2_ = nullptr, skip_ = nullptr;
};
TORCH_MODULE(SubdivideBlock);

/// Features of each coarse voxel: sum over its members / (members + 1), as published: the zero that the sum starts from
/// is counted (docs/reference/autoencoders.md, 4.8). Rows sorted by item, x, y, z.
/// @param factor one for all axes, or one per axis @throws InputError for a factor below 1
SparseTensor downsample(const SparseTensor& x, const GridFactor& factor);
/// Every fine voxel takes the features of its coarse one. @param coarse on fine.coarsened(factor).support
SparseTensor upsample(const SparseTensor& coarse, const SupportPtr& fine, const GridFactor& factor);
/// Features repeated for the eight children of each voxel: on x.support->subdivided().
SparseTensor subdivide(const SparseTensor& x);

}  // namespace anigen::sparse
