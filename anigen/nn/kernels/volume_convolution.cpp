#include "anigen/nn/kernels/volume_convolution.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "anigen/core/kernel_form.h"

namespace anigen::nn::kernels {

namespace volume_tiles {
namespace {

struct ForwardTile {
  const float* runs[9];  // where the runs of the first voxel begin
  const float *weights, *bias;
  float* out;
  std::int64_t in, stride, lanes;  // of a run's step, of the output's voxels; channels to store
};

struct GradientTile {
  const float *values, *slopes;
  float* sums;
  std::int64_t lines, voxels, in, line_stride, slope_stride, sum_stride;
};

template <typename Tile>
struct TileTable {
  using Function = void (*)(const Tile&);
  Function of[2][12];
};

namespace portable {
#include "anigen/nn/kernels/volume_convolution_tiles.inc"
}  // namespace portable

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC push_options
#pragma GCC target("avx2,fma")
namespace fused {
#include "anigen/nn/kernels/volume_convolution_tiles.inc"
}  // namespace fused
#pragma GCC pop_options
#else
namespace fused = portable;
#endif

bool takes_fused() { return kernel_form() >= KernelForm::kAvx2; }

// Twelve sums fill the registers and hide how long an addition takes.
constexpr std::int64_t kMostSums = 12;

// Cuts [0, total) into as few parts of at most `most` as possible, of about equal length.
struct Parts {
  Parts(std::int64_t length, std::int64_t most) : total(length), count((length + most - 1) / most) {}
  std::int64_t begin(std::int64_t i) const { return total * i / count; }
  std::int64_t size(std::int64_t i) const { return begin(i + 1) - begin(i); }
  std::int64_t total, count;
};

// Three neighbouring slabs [y + 2, z + 2, in] with a border of zeros, for x going up.
class PaddedSlabs {
 public:
  PaddedSlabs(const VolumeConvolutionSizes& sizes, const float* input)
      : sizes_(sizes),
        input_(input),
        line_((sizes.z + 2) * sizes.in),
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

  // Line y + dy of slab x + dx, for offsets 0 … 2 that stand for −1 … 1, from the border on.
  const float* line(std::int64_t y, std::int64_t dx, std::int64_t dy) const {
    return values_.data() + (first_ + dx) % 3 * slab_ + (y + dy) * line_;
  }

 private:
  // Slab x lies in place (x + 1) mod 3.
  void fill(std::int64_t item, std::int64_t x) {
    float* to = values_.data() + (x + 1) % 3 * slab_;
    if (x < 0 || x >= sizes_.x) {
      std::fill_n(to, slab_, 0.0F);
      return;
    }
    const std::int64_t row = sizes_.z * sizes_.in;
    const float* from = input_ + (item * sizes_.x + x) * sizes_.y * row;
    std::fill_n(to, line_, 0.0F);
    for (std::int64_t y = 0; y < sizes_.y; ++y, from += row) {
      to += line_;
      std::fill_n(to, sizes_.in, 0.0F);
      std::copy_n(from, row, to + sizes_.in);
      std::fill_n(to + sizes_.in + row, sizes_.in, 0.0F);
    }
    std::fill_n(to + line_, line_, 0.0F);
  }

  VolumeConvolutionSizes sizes_;
  const float* input_;
  std::int64_t line_, slab_, first_ = 0, last_ = -2;
  std::vector<float> values_;
};

// The weight of tap t (0 … 26), input channel i and output channel o lies at
// packed[27 · in · first + (t · in + i) · width + o − first] where `first` begins o's block of `width` channels.
template <typename Weight>
void pack_blocks(std::int64_t in, std::int64_t out, float* packed, const Weight& weight_of) {
  const std::int64_t padded = (out + 7) / 8 * 8;
  for (std::int64_t first = 0; first < padded; first += 16) {
    const std::int64_t width = std::min<std::int64_t>(16, padded - first);
    for (std::int64_t tap = 0; tap < 27; ++tap) {
      for (std::int64_t i = 0; i < in; ++i) {
        for (std::int64_t o = first; o < first + width; ++o) *packed++ = o < out ? weight_of(o, i, tap) : 0.0F;
      }
    }
  }
}

// Slopes of some lines with the channels filled up to whole vectors.
const float* padded_rows(const float* slope, std::int64_t rows, const VolumeConvolutionSizes& sizes,
                         std::vector<float>& scratch) {
  const std::int64_t padded = sizes.padded_out();
  if (padded == sizes.out) return slope;
  scratch.assign(static_cast<std::size_t>(rows * padded), 0.0F);
  for (std::int64_t r = 0; r < rows; ++r) std::copy_n(slope + r * sizes.out, sizes.out, scratch.data() + r * padded);
  return scratch.data();
}

// First the rows alone, so that no value is added to a sum much larger than itself.
void add_bias_gradient(const float* slopes, std::int64_t rows, std::vector<float>& row_sums, float* sums) {
  std::fill(row_sums.begin(), row_sums.end(), 0.0F);
  for (std::int64_t r = 0; r < rows; ++r) {
    for (float& sum : row_sums) sum += *slopes++;
  }
  for (const float sum : row_sums) *sums++ += sum;
}

// Voxels whose values are taken together: as many as a first-level cache holds, but enough that to load and to store
// sums is little work beside adding to them.
std::int64_t gradient_voxels(const VolumeConvolutionSizes& sizes) {
  constexpr std::int64_t kFloats = 4096, kFewest = 64;
  return std::max(kFewest, kFloats / (sizes.in + sizes.padded_out()));
}

}  // namespace
}  // namespace volume_tiles

void pack_volume_weights(const float* weight, const VolumeConvolutionSizes& sizes, float* packed) {
  volume_tiles::pack_blocks(sizes.in, sizes.out, packed, [&](std::int64_t o, std::int64_t i, std::int64_t tap) {
    return weight[(o * sizes.in + i) * 27 + tap];
  });
}

void pack_transposed_volume_weights(const float* weight, const VolumeConvolutionSizes& sizes, float* packed) {
  volume_tiles::pack_blocks(sizes.out, sizes.in, packed, [&](std::int64_t o, std::int64_t i, std::int64_t tap) {
    return weight[(i * sizes.in + o) * 27 + 26 - tap];
  });
}

void convolve_slabs(const VolumeConvolutionSizes& sizes, const float* input, const float* packed, const float* bias,
                    float* output, std::int64_t begin, std::int64_t end) {
  using namespace volume_tiles;
  const auto& tiles = takes_fused() ? fused::kForwardTiles : portable::kForwardTiles;
  const std::int64_t padded = sizes.padded_out();
  PaddedSlabs slabs(sizes, input);
  ForwardTile tile{};
  tile.in = sizes.in;
  tile.stride = sizes.out;
  for (std::int64_t slab = begin; slab < end; ++slab) {
    slabs.move_to(slab);
    // A block of channels at a time: its weights stay in a cache for the whole slab.
    for (std::int64_t first = 0; first < padded; first += 16) {
      const std::int64_t vectors = std::min<std::int64_t>(16, padded - first) / 8;
      const Parts parts(sizes.z, kMostSums / vectors);
      tile.weights = packed + 27 * sizes.in * first;
      tile.bias = bias + first;
      tile.lanes = std::min<std::int64_t>(8 * vectors, sizes.out - first);
      for (std::int64_t y = 0; y < sizes.y; ++y) {
        for (std::int64_t part = 0; part < parts.count; ++part) {
          const std::int64_t z = parts.begin(part);
          for (int run = 0; run < 9; ++run) tile.runs[run] = slabs.line(y, run / 3, run % 3) + z * sizes.in;
          tile.out = output + ((slab * sizes.y + y) * sizes.z + z) * sizes.out + first;
          tiles.of[vectors - 1][parts.size(part) - 1](tile);
        }
      }
    }
  }
}

void add_weight_gradient(const VolumeConvolutionSizes& sizes, const float* input, const float* slope,
                         std::int64_t begin, std::int64_t end, float* weight_sums, float* bias_sums) {
  using namespace volume_tiles;
  const auto& tiles = takes_fused() ? fused::kGradientTiles : portable::kGradientTiles;
  const std::int64_t padded = sizes.padded_out(), run_length = 3 * sizes.in;
  const Parts groups(sizes.y, std::max<std::int64_t>(1, gradient_voxels(sizes) / sizes.z));
  PaddedSlabs slabs(sizes, input);
  std::vector<float> scratch, row_sums(static_cast<std::size_t>(padded));
  GradientTile tile{};
  tile.voxels = sizes.z;
  tile.in = sizes.in;
  tile.line_stride = slabs.line_stride();
  tile.slope_stride = tile.sum_stride = padded;
  for (std::int64_t slab = begin; slab < end; ++slab) {
    slabs.move_to(slab);
    for (std::int64_t group = 0; group < groups.count; ++group) {
      const std::int64_t y = groups.begin(group);
      tile.lines = groups.size(group);
      const std::int64_t rows = tile.lines * sizes.z;
      const float* slopes = padded_rows(slope + (slab * sizes.y + y) * sizes.z * sizes.out, rows, sizes, scratch);
      add_bias_gradient(slopes, rows, row_sums, bias_sums);
      for (std::int64_t run = 0; run < 9; ++run) {
        const float* values = slabs.line(y, run / 3, run % 3);
        for (std::int64_t first = 0; first < padded; first += 16) {
          const std::int64_t vectors = std::min<std::int64_t>(16, padded - first) / 8;
          const Parts parts(run_length, kMostSums / vectors);
          tile.slopes = slopes + first;
          for (std::int64_t part = 0; part < parts.count; ++part) {
            const std::int64_t q = parts.begin(part);
            tile.values = values + q;
            tile.sums = weight_sums + (run * run_length + q) * padded + first;
            tiles.of[vectors - 1][parts.size(part) - 1](tile);
          }
        }
      }
    }
  }
}

}  // namespace anigen::nn::kernels
