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

// A line [z + 2, in] of a slab.
void copy_line(const float* from, std::int64_t z, std::int64_t in, float* to) {
  std::fill_n(to, in, 0.0F);
  std::copy_n(from, z * in, to + in);
  std::fill_n(to + (z + 1) * in, in, 0.0F);
}

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
  PaddedSlabs<float> slabs(sizes, input, sizes.in, copy_line);
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
  PaddedSlabs<float> slabs(sizes, input, sizes.in, copy_line);
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
