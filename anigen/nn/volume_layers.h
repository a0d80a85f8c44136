#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// 3-D cross-correlation over [B, C, X, Y, Z] with keys `weight` [out, in, k, k, k] and `bias` [out], like
/// torch::nn::Conv3d but without drawing initial values (see Linear). In fp32 on a CPU the kernels 3³ with padding 1
/// and k³ of stride k run on our own code (volume_convolution.h), can be differentiated once (3³), and give
/// ChannelsLast3d.
class Conv3dImpl : public torch::nn::Module {
 public:
  Conv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, std::int64_t stride = 1,
             std::int64_t padding = 0);
  Tensor forward(const Tensor& x);
  Tensor weight, bias;

 private:
  std::int64_t stride_, padding_;
};
TORCH_MODULE(Conv3d);

/// Norm of dense volumes, in fp32 and cast back. "layer": over the channels at each voxel, eps 1e-5 (reference
/// autoencoders.md, 0.2, CLN); "group": over the cells and the channels of a group, eps 1e-5. Keys `weight`, `bias`,
/// not initialised (see Linear). "layer" keeps the memory format, contiguous or ChannelsLast3d.
class VolumeNormImpl : public torch::nn::Module {
 public:
  enum class Kind { kLayer, kGroup };
  explicit VolumeNormImpl(std::int64_t channels, Kind kind = Kind::kLayer, std::int64_t groups = 32);
  Tensor forward(const Tensor& x);    ///< @param x [B, C, X, Y, Z]
  Tensor activated(const Tensor& x);  ///< SiLU of it (norm_silu.h)
  Tensor weight, bias;

 private:
  Tensor group_norm(const Tensor& x) const;

  Kind kind_;
  std::int64_t groups_;
};
TORCH_MODULE(VolumeNorm);

}  // namespace anigen::nn
