#pragma once
#include <string>
#include <vector>

#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/dense_block.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/sparse/attention.h"

namespace anigen::sparse {

struct SparseBlockOptions {
  std::int64_t channels = 0;
  std::int64_t num_heads = 1;
  double mlp_ratio = 4.0;
  AttentionScope scope;        ///< of the self attention
  AttentionScope cross_scope;  ///< of the cross attentions
  bool qkv_bias = true;
  bool qk_rms_norm = false, qk_rms_norm_cross = false;
  bool affine_norms = false;                   ///< parameters in norm1, norm2 (norm3 and norm4 of cross blocks)
  std::vector<std::int64_t> context_channels;  ///< of a multi-context block, one per context; of a cross block, its one
  bool norm_context = false;                   ///< of a cross block: norm4 of the context (published context_is_dual)
  std::string attention_name = "attn";         ///< key of the self attention of a SparseTransformerBlock
};

/// x += attn(LN(x)), x += mlp(LN(x)), eps 1e-6 (reference autoencoders.md, 0.2 and 3.1). Keys `norm{1,2}.*` with
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
/// (reference flows-and-pipeline.md, 3.7). Keys `norm{1,2,3,4}.*` with affine_norms, `self_attn.*`, `cross_attn.*`,
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
/// order, then the MLP; eps 1e-6 (reference autoencoders.md, 3.1, cross-stream). Keys in this order: `norm2.*`,
/// `self_attn.*`, `cross_attn_{k}.*` and `ctx_norm_{k}.*` for each context, `mlp.mlp.*`; norm1 and norm3 have
/// parameters only with affine_norms. Without contexts there is no norm2: a SparseTransformerBlock whose attention is
/// named `self_attn`.
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

}  // namespace anigen::sparse
