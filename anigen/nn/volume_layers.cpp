#include "anigen/nn/volume_layers.h"

#include "anigen/nn/volume_convolution.h"

namespace anigen::nn {

Conv3dImpl::Conv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, std::int64_t stride,
                       std::int64_t padding)
    : stride_(stride), padding_(padding) {
  weight = register_parameter("weight", torch::empty({out_channels, in_channels, kernel, kernel, kernel}));
  bias = register_parameter("bias", torch::empty({out_channels}));
}

Tensor Conv3dImpl::forward(const Tensor& x) {
  if (volume_convolution_supports(x, weight, stride_, padding_)) return volume_convolution(x, weight, bias);
  if (patch_convolution_supports(x, weight, stride_, padding_)) return patch_convolution(x, weight, bias);
  return torch::conv3d(x, weight, bias, {stride_, stride_, stride_}, {padding_, padding_, padding_});
}

VolumeNormImpl::VolumeNormImpl(std::int64_t channels, Kind kind, std::int64_t groups) : kind_(kind), groups_(groups) {
  TORCH_CHECK(kind == Kind::kLayer || (groups > 0 && channels % groups == 0), "group norm: ", channels,
              " channels do not divide into ", groups, " groups");
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

Tensor VolumeNormImpl::forward(const Tensor& x) {
  constexpr double kEps = 1e-5;
  const torch::Dtype dtype = dtype_of(x), wide = accumulation_dtype(dtype);
  if (kind_ == Kind::kGroup) {
    return torch::group_norm(x.to(wide).contiguous(), groups_, weight.to(wide), bias.to(wide), kEps).to(dtype);
  }
  const Tensor rows = x.to(wide).movedim(1, -1);
  const Tensor normed = torch::layer_norm(rows, {rows.size(-1)}, weight.to(wide), bias.to(wide), kEps);
  return normed.to(dtype).movedim(-1, 1).contiguous(x.suggest_memory_format());
}

}  // namespace anigen::nn
