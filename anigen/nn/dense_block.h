#pragma once
#include <string>

#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/dense_attention.h"
#include "anigen/nn/feed_forward.h"

namespace anigen::nn {

struct DenseBlockOptions {
  std::int64_t channels = 0;
  std::int64_t out_channels = 0;      ///< 0: channels; another width sends the last residual through `res_mlp`
  std::int64_t context_channels = 0;  ///< of the cross block
  std::int64_t num_heads = 1;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
  bool qk_rms_norm = false, qk_rms_norm_cross = false;
  bool affine_norms = false;   ///< layer norms with parameters (keys `norm{1,2,3}.*`)
  bool self_attention = true;  ///< false: a cross block without its first step (published as no_self)
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

/// Pre-norm block over a dense batch: x += attn(LN(x)), then BlockOutput (reference flows-and-pipeline.md, 3.8). Keys
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

/// x += self(LN1(x)), x += cross(LN2(x), context), then BlockOutput with LN3; the context is not normalised (reference
/// flows-and-pipeline.md, 3.8). Keys `norm{1,2,3}.*` if affine, `self_attn.*`, `cross_attn.*`, `mlp.mlp.*`,
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

/// Vertices take up the joints' features by their skin weights, joints attend to each other (reference
/// flows-and-pipeline.md, 3.8): x ← x + skin · to_v(LN1 j), then BlockOutput with LN2; u = j + attn(LN3 j), then
/// j ← (j or res_joint_mlp(j)) + joint_mlp(u) without a norm. Keys `norm{1,2,3}.*` if affine, `joint_attn.*`, `to_v.*`,
/// `mlp.mlp.*`, `joint_mlp.mlp.*`, `res_mlp.mlp.*`, `res_joint_mlp.mlp.*`.
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
