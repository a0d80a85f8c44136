#pragma once
#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/modulated_block.h"
#include "anigen/sparse/convolution.h"

namespace anigen::sparse {

struct ResidualBlockOptions {
  std::int64_t channels = 0, out_channels = 0;
  std::int64_t embedding_channels = 0;  ///< of the time embedding
};

/// Residual block of the structured-latent flow before and after its transformers (reference flows-and-pipeline.md,
/// 2.2): h = conv1(SiLU(LN(x; affine))), h = conv2(SiLU(LN(h) (1 + scale) + shift)), plus x through a linear layer
/// where the width changes. Scale and shift come from the embedding, the scale first. Norms are over the channels of
/// each voxel, eps 1e-6. Keys `norm1.*`, `conv1.conv.*`, `conv2.conv.*`, `emb_layers.1.*`, `skip_connection.*`.
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
  Tensor activated(const Tensor& rows);
  Tensor skipped(const Tensor& rows);
  SparseTensor finish(const SparseTensor& h, const Tensor& skip, const Tensor& embedding);

  nn::AffineLayerNorm norm1_ = nullptr;
  SubmanifoldConv3d conv1_ = nullptr, conv2_ = nullptr;
  nn::Modulation modulation_ = nullptr;
  nn::Linear skip_ = nullptr;
};
TORCH_MODULE(ResidualBlock);

}  // namespace anigen::sparse
