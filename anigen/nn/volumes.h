#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// [B, C, X, Y, Z] → [B, C p³, X/p, Y/p, Z/p]; channel ((c p + i) p + j) p + k holds offset (i, j, k) of the patch
/// (docs/reference/flows.md, 1.3).
Tensor patchify(const Tensor& volume, std::int64_t patch);
Tensor unpatchify(const Tensor& patches, std::int64_t patch);  ///< inverse of patchify

/// [B, C s³, X, Y, Z] → [B, C, sX, sY, sZ] in the same channel order (docs/reference/autoencoders.md, 3.1). Keeps the
/// memory format, contiguous or ChannelsLast3d.
Tensor pixel_shuffle_3d(const Tensor& volume, std::int64_t scale);

/// True when volume_convolution can stand for torch::conv3d with this stride and padding: fp32 on a CPU, a 3³ kernel,
/// stride 1 and padding 1, and an input with values.
bool volume_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding);

/// 3³ cross-correlation of stride 1 and padding 1 in fp32 on a CPU, made for few channels and large volumes: channels
/// of a voxel lie side by side, and each thread holds three padded slabs of the input. Results do not depend on the
/// number of threads, to the bit. Can be differentiated once; a second time is an error. Where mixed_products()
/// (nn/kernels/mixed_products.h), values, weights and slopes are rounded to bf16 when they are multiplied, in the
/// backward pass too.
/// @param x [B, I, X, Y, Z] of any strides; torch::MemoryFormat::ChannelsLast3d is read without a copy
/// @param weight [O, I, 3, 3, 3] @param bias [O] @return [B, O, X, Y, Z], ChannelsLast3d
Tensor volume_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias);

/// True when torch::conv3d without padding is a product of dense rows with a matrix: an fp32 volume on a CPU, a kernel
/// as long as its stride, and edges that are multiples of it (1³, or 2³ of stride 2).
bool patch_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding);

/// Convolution of stride k and padding 0, as such a product. @param x [B, I, X, Y, Z] @param weight [O, I, k, k, k]
/// @param bias [O] @return [B, O, X/k, Y/k, Z/k], ChannelsLast3d
Tensor patch_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias);

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

/// Norm of dense volumes, in fp32 and cast back. "layer": over the channels at each voxel, eps 1e-5
/// (docs/reference/autoencoders.md, 1.2); "group": over the cells and the channels of a group, eps 1e-5. Keys `weight`,
/// `bias`, not initialised (see Linear). "layer" keeps the memory format, contiguous or ChannelsLast3d.
class VolumeNormImpl : public torch::nn::Module {
 public:
  enum class Kind { kLayer, kGroup };
  explicit VolumeNormImpl(std::int64_t channels, Kind kind = Kind::kLayer, std::int64_t groups = 32);
  Tensor forward(const Tensor& x);    ///< @param x [B, C, X, Y, Z]
  Tensor activated(const Tensor& x);  ///< SiLU of it (norm_silu)
  Tensor weight, bias;

 private:
  Tensor group_norm(const Tensor& x) const;

  Kind kind_;
  std::int64_t groups_;
};
TORCH_MODULE(VolumeNorm);

}  // namespace anigen::nn
