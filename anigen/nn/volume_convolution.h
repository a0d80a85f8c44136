#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Whether volume_convolution can stand for torch::conv3d with this stride and padding: fp32 on a CPU, a 3³ kernel,
/// stride 1 and padding 1, and an input with values.
bool volume_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding);

/// 3³ cross-correlation of stride 1 and padding 1 in fp32 on a CPU, made for few channels and large volumes: channels
/// of a voxel lie side by side, and each thread holds three padded slabs of the input. Results do not depend on the
/// number of threads, to the bit. Can be differentiated once; a second time is an error.
/// @param x [B, I, X, Y, Z] of any strides; torch::MemoryFormat::ChannelsLast3d is read without a copy
/// @param weight [O, I, 3, 3, 3] @param bias [O] @return [B, O, X, Y, Z], ChannelsLast3d
Tensor volume_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias);

/// Whether torch::conv3d without padding is a product of dense rows with a matrix: an fp32 volume on a CPU, a kernel as
/// long as its stride, and edges that are multiples of it (1³, or 2³ of stride 2).
bool patch_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding);

/// Convolution of stride k and padding 0, as such a product. @param x [B, I, X, Y, Z] @param weight [O, I, k, k, k]
/// @param bias [O] @return [B, O, X/k, Y/k, Z/k], ChannelsLast3d
Tensor patch_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias);

}  // namespace anigen::nn
