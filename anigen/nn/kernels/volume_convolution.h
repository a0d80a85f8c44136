#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

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

/// Parts of the kernels of 3³ convolutions that do not depend on the type of the factors.
namespace anigen::nn::kernels::volume_tiles {

/// Twelve vectors of sums, or pairs of them, fill the registers and hide how long an addition takes.
inline constexpr std::int64_t kMostSums = 12;

/// Cuts [0, total) into as few parts of at most `most` as possible, of about equal length.
struct Parts {
  Parts(std::int64_t length, std::int64_t most) : total(length), count((length + most - 1) / most) {}
  std::int64_t begin(std::int64_t i) const { return total * i / count; }
  std::int64_t size(std::int64_t i) const { return begin(i + 1) - begin(i); }
  std::int64_t total, count;
};

/// Three neighbouring slabs [y + 2, z + 2, channels] with a border of zeros, for x going up.
template <typename Value>
class PaddedSlabs {
 public:
  /// Writes one line [z + 2, channels], border included, from [z, in].
  using FillLine = void (*)(const float* from, std::int64_t z, std::int64_t in, Value* to);

  /// @param input [batch, x, y, z, in] dense @param channels of a stored voxel
  PaddedSlabs(const VolumeConvolutionSizes& sizes, const float* input, std::int64_t channels, FillLine fill_line)
      : sizes_(sizes),
        input_(input),
        fill_line_(fill_line),
        line_((sizes.z + 2) * channels),
        slab_((sizes.y + 2) * line_),
        values_(static_cast<std::size_t>(3 * slab_)) {}

  void move_to(std::int64_t slab) {
    const std::int64_t item = slab / sizes_.x, x = slab % sizes_.x;
    const bool follows = slab == last_ + 1 && x > 0;
    for (std::int64_t plane = follows ? x + 1 : x - 1; plane <= x + 1; ++plane) fill(item, plane);
    first_ = x;
    last_ = slab;
  }

  std::int64_t line_stride() const { return line_; }

  /// Line y + dy of slab x + dx, for offsets 0 … 2 that stand for −1 … 1, from the border on.
  const Value* line(std::int64_t y, std::int64_t dx, std::int64_t dy) const {
    return values_.data() + (first_ + dx) % 3 * slab_ + (y + dy) * line_;
  }

 private:
  // Slab x lies in place (x + 1) mod 3.
  void fill(std::int64_t item, std::int64_t x) {
    Value* to = values_.data() + (x + 1) % 3 * slab_;
    if (x < 0 || x >= sizes_.x) {
      std::fill_n(to, slab_, Value{});
      return;
    }
    const std::int64_t row = sizes_.z * sizes_.in;
    const float* from = input_ + (item * sizes_.x + x) * sizes_.y * row;
    std::fill_n(to, line_, Value{});
    for (std::int64_t y = 0; y < sizes_.y; ++y, from += row) fill_line_(from, sizes_.z, sizes_.in, to += line_);
    std::fill_n(to + line_, line_, Value{});
  }

  VolumeConvolutionSizes sizes_;
  const float* input_;
  FillLine fill_line_;
  std::int64_t line_, slab_, first_ = 0, last_ = -2;
  std::vector<Value> values_;
};

}  // namespace anigen::nn::kernels::volume_tiles
