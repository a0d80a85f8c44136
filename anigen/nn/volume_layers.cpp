#include "anigen/nn/volume_layers.h"

#include "anigen/nn/modulated_rows.h"
#include "anigen/nn/norm_silu.h"
#include "anigen/nn/volume_convolution.h"

namespace anigen::nn {
namespace {

constexpr double kEps = 1e-5;

// body([..., C], channels of a voxel side by side) of a volume [B, C, X, Y, Z], in its memory format.
template <typename Body>
Tensor by_voxel(const Tensor& x, const Body& body) {
  return body(x.movedim(1, -1)).movedim(-1, 1).contiguous(x.suggest_memory_format());
}

}  // namespace

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

Tensor VolumeNormImpl::group_norm(const Tensor& x) const {
  const torch::Dtype dtype = dtype_of(x), wide = accumulation_dtype(dtype);
  return torch::group_norm(x.to(wide).contiguous(), groups_, weight.to(wide), bias.to(wide), kEps).to(dtype);
}

Tensor VolumeNormImpl::forward(const Tensor& x) {
  if (kind_ == Kind::kGroup) return group_norm(x);
  return by_voxel(x, [&](const Tensor& rows) { return affine_norm(rows, weight, bias, kEps); });
}

Tensor VolumeNormImpl::activated(const Tensor& x) {
  if (kind_ == Kind::kGroup) return torch::silu(group_norm(x));
  return by_voxel(x, [&](const Tensor& rows) { return norm_silu(rows, weight, bias, kEps); });
}

}  // namespace anigen::nn
