#include "anigen/nn/kernels/volume_convolution_bf16.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <utility>
#include <vector>

#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/kernels/volume_convolution.h"

namespace anigen::nn::kernels {

#if ANIGEN_BF16_X86
ANIGEN_BF16_BEGIN

namespace volume_tiles {
namespace {

// Numbers of 32 bits are pairs of bf16 numbers, which one step multiplies and adds up: two channels of a voxel for the
// output, and two voxels along z for the gradient of the weight. Output channels are taken 32, 16 or 8 at a time.

// Vectors of 16 sums.
struct Lanes16 {
  static constexpr std::int64_t kCount = 16;
  using Sum = __m512;
  using Factor = __m512bh;

  ANIGEN_BF16_INLINE static Factor load_factor(const void* from) {
    return reinterpret_cast<__m512bh>(_mm512_loadu_si512(from));
  }
  ANIGEN_BF16_INLINE static Factor broadcast(std::int32_t pair) {
    return reinterpret_cast<__m512bh>(_mm512_set1_epi32(pair));
  }
  ANIGEN_BF16_INLINE static Sum add_products(Sum sum, Factor a, Factor b) { return _mm512_dpbf16_ps(sum, a, b); }
  ANIGEN_BF16_INLINE static Sum zero() { return _mm512_setzero_ps(); }
  ANIGEN_BF16_INLINE static Sum load(const float* from) { return _mm512_loadu_ps(from); }
  ANIGEN_BF16_INLINE static void store(float* to, Sum sum) { _mm512_storeu_ps(to, sum); }
  ANIGEN_BF16_INLINE static void store_first(float* to, std::int64_t count, Sum sum) {
    _mm512_mask_storeu_ps(to, static_cast<__mmask16>(count >= kCount ? 0xffffU : (1U << count) - 1), sum);
  }
  ANIGEN_BF16_INLINE static void add_to(float* to, Sum sum) { store(to, _mm512_add_ps(load(to), sum)); }
};

// Vectors of 8 sums, for the last 8 channels. Zen 4 handles vectors of 16 in two halves: these take half the time.
struct Lanes8 {
  static constexpr std::int64_t kCount = 8;
  using Sum = __m256;
  using Factor = __m256bh;

  ANIGEN_BF16_INLINE static Factor load_factor(const void* from) {
    return reinterpret_cast<__m256bh>(_mm256_loadu_si256(static_cast<const __m256i*>(from)));
  }
  ANIGEN_BF16_INLINE static Factor broadcast(std::int32_t pair) {
    return reinterpret_cast<__m256bh>(_mm256_set1_epi32(pair));
  }
  ANIGEN_BF16_INLINE static Sum add_products(Sum sum, Factor a, Factor b) { return _mm256_dpbf16_ps(sum, a, b); }
  ANIGEN_BF16_INLINE static Sum zero() { return _mm256_setzero_ps(); }
  ANIGEN_BF16_INLINE static Sum load(const float* from) { return _mm256_loadu_ps(from); }
  ANIGEN_BF16_INLINE static void store(float* to, Sum sum) { _mm256_storeu_ps(to, sum); }
  ANIGEN_BF16_INLINE static void store_first(float* to, std::int64_t count, Sum sum) {
    _mm256_mask_storeu_ps(to, static_cast<__mmask8>(count >= kCount ? 0xffU : (1U << count) - 1), sum);
  }
  ANIGEN_BF16_INLINE static void add_to(float* to, Sum sum) { store(to, _mm256_add_ps(load(to), sum)); }
};

struct PairForwardTile {
  const std::uint16_t* runs[9];  // where the runs of the first voxel begin
  const std::uint16_t* weights;
  const float* bias;
  float* out;
  std::int64_t run_pairs, voxel, stride,
      lanes;  // `voxel` numbers of a voxel; stride of the output's; channels to store
};

// Output channels of kVectors vectors of kVoxels voxels along z, all 9 runs.
template <typename Lanes, int kVectors, int kVoxels>
ANIGEN_BF16 void pair_forward_tile(const PairForwardTile& tile) {
  typename Lanes::Sum sums[kVoxels][kVectors];
#pragma GCC unroll 16
  for (int v = 0; v < kVoxels; ++v) {
#pragma GCC unroll 2
    for (int n = 0; n < kVectors; ++n) sums[v][n] = Lanes::load(tile.bias + n * Lanes::kCount);
  }
  const std::uint16_t* weights = tile.weights;
  const std::int64_t voxel = tile.voxel;
  for (int run = 0; run < 9; ++run) {
    const std::uint16_t* values = tile.runs[run];
    for (std::int64_t pair = 0; pair < tile.run_pairs; ++pair, values += 2, weights += 2 * kVectors * Lanes::kCount) {
      typename Lanes::Factor w[kVectors];
#pragma GCC unroll 2
      for (int n = 0; n < kVectors; ++n) w[n] = Lanes::load_factor(weights + 2 * n * Lanes::kCount);
#pragma GCC unroll 16
      for (int v = 0; v < kVoxels; ++v) {
        std::int32_t value;
        std::memcpy(&value, values + v * voxel, sizeof value);
        const typename Lanes::Factor factor = Lanes::broadcast(value);
#pragma GCC unroll 2
        for (int n = 0; n < kVectors; ++n) sums[v][n] = Lanes::add_products(sums[v][n], factor, w[n]);
      }
    }
  }
  float* const out = tile.out;
  const std::int64_t stride = tile.stride, lanes = tile.lanes;
#pragma GCC unroll 16
  for (int v = 0; v < kVoxels; ++v) {
#pragma GCC unroll 2
    for (int n = 0; n < kVectors; ++n)
      Lanes::store_first(out + v * stride + n * Lanes::kCount, lanes - n * Lanes::kCount, sums[v][n]);
  }
}

struct PairGradientTile {
  const std::uint32_t *values, *slopes;
  float* sums;
  std::int64_t lines, pairs, value_stride, line_stride, slope_stride;  // pairs of voxels of a line; sums as slopes
};

// Adds Σ_voxels value[q] · slope[channel] for kRows values of a run and the output channels of kVectors vectors.
template <typename Lanes, int kVectors, int kRows>
ANIGEN_BF16 void pair_gradient_tile(const PairGradientTile& tile) {
  typename Lanes::Sum sums[kRows][kVectors];
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 2
    for (int n = 0; n < kVectors; ++n) sums[r][n] = Lanes::zero();
  }
  const std::uint32_t* slopes = tile.slopes;
  for (std::int64_t line = 0; line < tile.lines; ++line) {
    const std::uint32_t* values = tile.values + line * tile.line_stride;
    for (std::int64_t pair = 0; pair < tile.pairs; ++pair, values += tile.value_stride, slopes += tile.slope_stride) {
      typename Lanes::Factor slope[kVectors];
#pragma GCC unroll 2
      for (int n = 0; n < kVectors; ++n) slope[n] = Lanes::load_factor(slopes + n * Lanes::kCount);
#pragma GCC unroll 16
      for (int r = 0; r < kRows; ++r) {
        const typename Lanes::Factor factor = Lanes::broadcast(static_cast<std::int32_t>(values[r]));
#pragma GCC unroll 2
        for (int n = 0; n < kVectors; ++n) sums[r][n] = Lanes::add_products(sums[r][n], factor, slope[n]);
      }
    }
  }
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 2
    for (int n = 0; n < kVectors; ++n) Lanes::add_to(tile.sums + r * tile.slope_stride + n * Lanes::kCount, sums[r][n]);
  }
}

// Tiles by voxels or rows − 1.
template <typename Tile>
using PairTiles = std::array<void (*)(const Tile&), kMostSums>;

template <typename Lanes, int kVectors, int... kIndex>
constexpr PairTiles<PairForwardTile> pair_forward_tiles(std::integer_sequence<int, kIndex...>) {
  return {pair_forward_tile<Lanes, kVectors, kIndex + 1>...};
}
template <typename Lanes, int kVectors, int... kIndex>
constexpr PairTiles<PairGradientTile> pair_gradient_tiles(std::integer_sequence<int, kIndex...>) {
  return {pair_gradient_tile<Lanes, kVectors, kIndex + 1>...};
}

// Output channels that are taken together, and the tiles for them.
struct PairBlock {
  std::int64_t width;
  PairTiles<PairForwardTile> forward;
  PairTiles<PairGradientTile> gradient;
};

constexpr std::make_integer_sequence<int, kMostSums> kTileSizes{};
constexpr PairBlock kPairBlocks[] = {
    {32, pair_forward_tiles<Lanes16, 2>(kTileSizes), pair_gradient_tiles<Lanes16, 2>(kTileSizes)},
    {16, pair_forward_tiles<Lanes16, 1>(kTileSizes), pair_gradient_tiles<Lanes16, 1>(kTileSizes)},
    {8, pair_forward_tiles<Lanes8, 1>(kTileSizes), pair_gradient_tiles<Lanes8, 1>(kTileSizes)}};

// The widest block that fits into what is left of the channels, a multiple of 8.
const PairBlock& pair_block(std::int64_t left) {
  const PairBlock* block = kPairBlocks;
  while (block->width > left) ++block;
  return *block;
}

ANIGEN_BF16_INLINE __mmask16 first_lanes(std::int64_t count) {
  return static_cast<__mmask16>(count >= kBf16Lanes ? 0xffffU : (1U << count) - 1);
}

ANIGEN_BF16_INLINE __m512i rounded(__m512 x) {
  return _mm512_cvtepu16_epi32(reinterpret_cast<__m256i>(_mm512_cvtneps_pbh(x)));
}

// bf16 pairs of numbers, the first in the low half.
ANIGEN_BF16_INLINE __m512i pairs_of(__m512 first, __m512 second) {
  return _mm512_or_si512(rounded(first), _mm512_slli_epi32(rounded(second), 16));
}

ANIGEN_BF16_INLINE __m512 load_lanes(__mmask16 lanes, const float* from) {
  return from == nullptr ? _mm512_setzero_ps() : _mm512_maskz_loadu_ps(lanes, from);
}

ANIGEN_BF16 void round_numbers(const float* from, std::int64_t count, std::uint16_t* to) {
  for (std::int64_t i = 0; i < count; i += kBf16Lanes) {
    const __mmask16 lanes = first_lanes(count - i);
    const auto numbers = reinterpret_cast<__m256i>(_mm512_cvtneps_pbh(_mm512_maskz_loadu_ps(lanes, from + i)));
    _mm256_mask_storeu_epi16(to + i, lanes, numbers);
  }
}

// to[i] = the pair (first[i], second[i]); nullptr stands for zeros.
ANIGEN_BF16 void pair_numbers(const float* first, const float* second, std::int64_t count, std::uint32_t* to) {
  for (std::int64_t i = 0; i < count; i += kBf16Lanes) {
    const __mmask16 lanes = first_lanes(count - i);
    const __m512 low = load_lanes(lanes, first == nullptr ? nullptr : first + i);
    const __m512 high = load_lanes(lanes, second == nullptr ? nullptr : second + i);
    _mm512_mask_storeu_epi32(to + i, lanes, pairs_of(low, high));
  }
}

// A line of a slab in bf16, for pairs of channels: an odd number of them is filled up with zeros.
void round_line(const float* from, std::int64_t z, std::int64_t in, std::uint16_t* to) {
  const std::int64_t voxel = (in + 1) / 2 * 2;
  std::fill_n(to, voxel, 0);
  to += voxel;
  if (voxel == in) {
    round_numbers(from, z * in, to);
  } else {
    for (std::int64_t i = 0; i < z; ++i) {
      round_numbers(from + i * in, in, to + i * voxel);
      to[i * voxel + in] = 0;
    }
  }
  std::fill_n(to + z * voxel, voxel, 0);
}

// A line of a slab in pairs of voxels: each voxel of the line, border included, with the one after it.
void pair_line(const float* from, std::int64_t z, std::int64_t in, std::uint32_t* to) {
  const std::int64_t last = (z - 1) * in;
  pair_numbers(nullptr, from, in, to);
  pair_numbers(from, from + in, last, to + in);
  pair_numbers(from + last, nullptr, in, to + in + last);
  std::fill_n(to + 2 * in + last, in, 0U);
}

// Slopes of some lines in pairs of voxels [lines, ⌈z / 2⌉, padded out], an odd number of voxels filled up with zeros.
// Adds the slopes to the sums of the bias.
ANIGEN_BF16 void pair_slopes(const float* slope, std::int64_t lines, const VolumeConvolutionSizes& sizes,
                             std::uint32_t* to, float* bias_sums) {
  const std::int64_t padded = sizes.padded_out();
  for (std::int64_t first = 0; first < padded; first += kBf16Lanes) {
    const __mmask16 lanes = first_lanes(sizes.out - first), stored = first_lanes(padded - first);
    const float* from = slope + first;
    std::uint32_t* place = to + first;
    // These alone first, so that no slope is added to a sum much larger than itself.
    __m512 sum = _mm512_setzero_ps();
    for (std::int64_t line = 0; line < lines; ++line) {
      for (std::int64_t z = 0; z < sizes.z; z += 2, from += 2 * sizes.out, place += padded) {
        const __m512 a = load_lanes(lanes, from), b = load_lanes(lanes, z + 1 < sizes.z ? from + sizes.out : nullptr);
        sum = _mm512_add_ps(sum, _mm512_add_ps(a, b));
        _mm512_mask_storeu_epi32(place, stored, pairs_of(a, b));
      }
      from -= sizes.z % 2 * sizes.out;
    }
    _mm512_mask_storeu_ps(bias_sums + first, stored,
                          _mm512_add_ps(sum, _mm512_maskz_loadu_ps(stored, bias_sums + first)));
  }
}

// Weights of pairs of input channels. Those of pair p, tap t and output channel o lie at
// packed[54 · pairs · first + 2 · ((t · pairs + p) · width + o − first)] where `first` begins o's block of `width`
// channels. @param taps_of (output channel, input channel) → 27 weights @param mirrored tap t is weight 26 − t
template <typename Taps>
void pack_channel_pairs(std::int64_t in, std::int64_t out, bool mirrored, const Taps& taps_of, std::uint16_t* packed,
                        std::int64_t begin, std::int64_t end) {
  const std::int64_t pairs = (in + 1) / 2, padded = (out + 7) / 8 * 8;
  for (std::int64_t first = 0, width = 0; first < padded; first += width) {
    width = pair_block(padded - first).width;
    for (std::int64_t pair = begin; pair < end; ++pair) {
      std::uint16_t* const place = packed + 54 * pairs * first + 2 * pair * width;
      for (std::int64_t o = first; o < first + width; ++o) {
        std::uint32_t words[27] = {};
        const bool second = 2 * pair + 1 < in;
        if (o < out) pair_numbers(taps_of(o, 2 * pair), second ? taps_of(o, 2 * pair + 1) : nullptr, 27, words);
        for (std::int64_t tap = 0; tap < 27; ++tap) {
          const std::uint32_t word = words[mirrored ? 26 - tap : tap];
          std::memcpy(place + 2 * (tap * pairs * width + o - first), &word, sizeof word);
        }
      }
    }
  }
}

// Voxels whose values are taken together: enough that to load and to store sums is little work beside adding to them.
constexpr std::int64_t kGradientVoxels = 256;

}  // namespace
}  // namespace volume_tiles

void pack_volume_weights_bf16(const float* weight, const VolumeConvolutionSizes& sizes, std::uint16_t* packed,
                              std::int64_t begin, std::int64_t end) {
  const auto taps = [&](std::int64_t o, std::int64_t i) { return weight + (o * sizes.in + i) * 27; };
  volume_tiles::pack_channel_pairs(sizes.in, sizes.out, false, taps, packed, begin, end);
}

void pack_transposed_volume_weights_bf16(const float* weight, const VolumeConvolutionSizes& sizes,
                                         std::uint16_t* packed, std::int64_t begin, std::int64_t end) {
  const auto taps = [&](std::int64_t o, std::int64_t i) { return weight + (i * sizes.in + o) * 27; };
  volume_tiles::pack_channel_pairs(sizes.out, sizes.in, true, taps, packed, begin, end);
}

void convolve_slabs_bf16(const VolumeConvolutionSizes& sizes, const float* input, const std::uint16_t* packed,
                         const float* bias, float* output, std::int64_t begin, std::int64_t end) {
  using namespace volume_tiles;
  const std::int64_t padded = sizes.padded_out(), voxel = 2 * channel_pairs(sizes);
  const Parts parts(sizes.z, kMostSums);
  PaddedSlabs<std::uint16_t> slabs(sizes, input, voxel, round_line);
  PairForwardTile tile{};
  tile.run_pairs = 3 * channel_pairs(sizes);
  tile.voxel = voxel;
  tile.stride = sizes.out;
  for (std::int64_t slab = begin; slab < end; ++slab) {
    slabs.move_to(slab);
    // A block of channels at a time: its weights stay in a cache for the whole slab.
    for (std::int64_t first = 0, width = 0; first < padded; first += width) {
      const PairBlock& block = pair_block(padded - first);
      width = block.width;
      tile.weights = packed + 27 * voxel * first;
      tile.bias = bias + first;
      tile.lanes = std::min(width, sizes.out - first);
      for (std::int64_t y = 0; y < sizes.y; ++y) {
        for (std::int64_t part = 0; part < parts.count; ++part) {
          const std::int64_t z = parts.begin(part);
          for (int run = 0; run < 9; ++run) tile.runs[run] = slabs.line(y, run / 3, run % 3) + z * voxel;
          tile.out = output + ((slab * sizes.y + y) * sizes.z + z) * sizes.out + first;
          block.forward[static_cast<std::size_t>(parts.size(part) - 1)](tile);
        }
      }
    }
  }
}

void add_weight_gradient_bf16(const VolumeConvolutionSizes& sizes, const float* input, const float* slope,
                              std::int64_t begin, std::int64_t end, float* weight_sums, float* bias_sums) {
  using namespace volume_tiles;
  const std::int64_t padded = sizes.padded_out(), run_length = 3 * sizes.in;
  const Parts groups(sizes.y, std::max<std::int64_t>(1, kGradientVoxels / sizes.z)), parts(run_length, kMostSums);
  PaddedSlabs<std::uint32_t> slabs(sizes, input, sizes.in, pair_line);
  PairGradientTile tile{};
  tile.pairs = (sizes.z + 1) / 2;
  tile.value_stride = 2 * sizes.in;
  tile.line_stride = slabs.line_stride();
  tile.slope_stride = padded;
  std::vector<std::uint32_t> slopes(static_cast<std::size_t>((sizes.y / groups.count + 1) * tile.pairs * padded));
  for (std::int64_t slab = begin; slab < end; ++slab) {
    slabs.move_to(slab);
    for (std::int64_t group = 0; group < groups.count; ++group) {
      const std::int64_t y = groups.begin(group);
      tile.lines = groups.size(group);
      pair_slopes(slope + (slab * sizes.y + y) * sizes.z * sizes.out, tile.lines, sizes, slopes.data(), bias_sums);
      for (std::int64_t run = 0; run < 9; ++run) {
        const std::uint32_t* values = slabs.line(y, run / 3, run % 3);
        for (std::int64_t first = 0, width = 0; first < padded; first += width) {
          const PairBlock& block = pair_block(padded - first);
          width = block.width;
          tile.slopes = slopes.data() + first;
          for (std::int64_t part = 0; part < parts.count; ++part) {
            const std::int64_t q = parts.begin(part);
            tile.values = values + q;
            tile.sums = weight_sums + (run * run_length + q) * padded + first;
            block.gradient[static_cast<std::size_t>(parts.size(part) - 1)](tile);
          }
        }
      }
    }
  }
}

ANIGEN_BF16_END
#else

// has_bf16_products() said so.
void pack_volume_weights_bf16(const float*, const VolumeConvolutionSizes&, std::uint16_t*, std::int64_t, std::int64_t) {
  std::abort();
}

void pack_transposed_volume_weights_bf16(const float*, const VolumeConvolutionSizes&, std::uint16_t*, std::int64_t,
                                         std::int64_t) {
  std::abort();
}

void convolve_slabs_bf16(const VolumeConvolutionSizes&, const float*, const std::uint16_t*, const float*, float*,
                         std::int64_t, std::int64_t) {
  std::abort();
}

void add_weight_gradient_bf16(const VolumeConvolutionSizes&, const float*, const float*, std::int64_t, std::int64_t,
                              float*, float*) {
  std::abort();
}

#endif

}  // namespace anigen::nn::kernels
