#pragma once
#include <cstdint>

#include "anigen/nn/kernels/volume_convolution.h"

/// The kernels of volume_convolution.h with factors rounded to bf16 (to nearest, even on ties) where they are
/// multiplied, for CPUs where has_bf16_products() (nn/kernels/tiles.h). Tensors and sums stay fp32; any number of
/// channels will do: an odd one of the input is filled up with zeros. bf16 numbers are passed as their 16 bits.
namespace anigen::nn::kernels {

/// Pairs of input channels, the last one filled up.
inline std::int64_t channel_pairs(const VolumeConvolutionSizes& sizes) { return (sizes.in + 1) / 2; }

/// Length of packed weights.
inline std::int64_t bf16_volume_weights(const VolumeConvolutionSizes& sizes) {
  return std::int64_t{27} * 2 * channel_pairs(sizes) * sizes.padded_out();
}

/// weight [out, in, 3, 3, 3] dense → packed [bf16_volume_weights(sizes)], of which the pairs begin … end − 1 are
/// written.
void pack_volume_weights_bf16(const float* weight, const VolumeConvolutionSizes& sizes, std::uint16_t* packed,
                              std::int64_t begin, std::int64_t end);

/// The weights of the gradient of the input (pack_transposed_volume_weights), pairs of sizes.transposed().
void pack_transposed_volume_weights_bf16(const float* weight, const VolumeConvolutionSizes& sizes,
                                         std::uint16_t* packed, std::int64_t begin, std::int64_t end);

/// convolve_slabs of values and weights rounded to bf16.
void convolve_slabs_bf16(const VolumeConvolutionSizes& sizes, const float* input, const std::uint16_t* packed,
                         const float* bias, float* output, std::int64_t begin, std::int64_t end);

/// add_weight_gradient of values and slopes rounded to bf16; the gradient of the bias takes the slopes as they are.
void add_weight_gradient_bf16(const VolumeConvolutionSizes& sizes, const float* input, const float* slope,
                              std::int64_t begin, std::int64_t end, float* weight_sums, float* bias_sums);

}  // namespace anigen::nn::kernels
