#pragma once
#include <cstdint>

namespace anigen::nn::kernels {

/// Sizes of a 3³ convolution of stride 1 and padding 1 over dense volumes [batch, x, y, z, channels]. A slab is what
/// shares batch item and x: there are batch · x of them.
struct VolumeConvolutionSizes {
  std::int64_t batch, x, y, z, in, out;

  std::int64_t slabs() const { return batch * x; }
  std::int64_t weights() const { return 27 * in * padded_out(); }  ///< length of packed weights
  /// Output channels in whole vectors: those of packed weights, biases and sums.
  std::int64_t padded_out() const { return (out + 7) / 8 * 8; }
  VolumeConvolutionSizes transposed() const { return {batch, x, y, z, out, in}; }  ///< of the gradient of the input
};

/// weight [out, in, 3, 3, 3] dense → packed [sizes.weights()], as convolve_slabs reads it.
void pack_volume_weights(const float* weight, const VolumeConvolutionSizes& sizes, float* packed);

/// The weights of the gradient of the input, for convolve_slabs with sizes.transposed(): taps mirrored, channels
/// exchanged. @param packed [sizes.transposed().weights()]
void pack_transposed_volume_weights(const float* weight, const VolumeConvolutionSizes& sizes, float* packed);

/// The output of the slabs begin … end − 1. Every value is the same sum in the same order whatever the range.
/// @param input [batch, x, y, z, in] dense @param bias [sizes.padded_out()] @param output [batch, x, y, z, out] dense
void convolve_slabs(const VolumeConvolutionSizes& sizes, const float* input, const float* packed, const float* bias,
                    float* output, std::int64_t begin, std::int64_t end);

/// Adds what the slabs begin … end − 1 contribute to the gradients of weight and bias. @param slope dL/d output,
/// [batch, x, y, z, out] dense @param weight_sums [3, 3, 3, in, sizes.padded_out()] @param bias_sums
/// [sizes.padded_out()]; in both the channels from `out` on get nothing
void add_weight_gradient(const VolumeConvolutionSizes& sizes, const float* input, const float* slope,
                         std::int64_t begin, std::int64_t end, float* weight_sums, float* bias_sums);

}  // namespace anigen::nn::kernels
