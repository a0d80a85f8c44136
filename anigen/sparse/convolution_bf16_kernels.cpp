#include "anigen/sparse/convolution_bf16_kernels.h"

#include <algorithm>
#include <cstdlib>

#include "anigen/nn/bf16_tile.h"

namespace anigen::sparse::kernels {
namespace {

using nn::kernels::kBf16Lanes;

constexpr std::int64_t kPanelColumns = 64;

}  // namespace

bool bf16_pairs_take(std::int64_t in_channels, std::int64_t out_channels) {
  return in_channels % 2 == 0 && out_channels % kBf16Lanes == 0;
}

void pack_bf16_matrix(const std::uint16_t* matrix, std::int64_t in_channels, std::int64_t out_channels,
                      std::uint16_t* packed) {
  for (std::int64_t first = 0; first < out_channels; first += kPanelColumns) {
    const std::int64_t columns = std::min(kPanelColumns, out_channels - first);
    for (std::int64_t k = 0; k < in_channels; k += 2) {
      for (std::int64_t c = 0; c < columns; ++c) {
        *packed++ = matrix[k * out_channels + first + c];
        *packed++ = matrix[(k + 1) * out_channels + first + c];
      }
    }
  }
}

#if ANIGEN_BF16_X86
ANIGEN_BF16_BEGIN
namespace {

// Input channels between reading and writing a tile: the part of a panel used meanwhile stays in the first-level cache.
constexpr std::int64_t kBf16Depth = 256;

template <int kVectors>
ANIGEN_BF16 void multiply_panel(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                                const std::uint16_t* panel, float* out, std::int64_t out_channels) {
  for (std::int64_t k = 0; k < in_channels; k += kBf16Depth) {
    nn::kernels::bf16_rows<kVectors, true>([=](std::int64_t i) { return in + pairs.from[i] * in_channels + k; },
                                           [=](std::int64_t i) { return out + pairs.to[i] * out_channels; },
                                           pairs.count, std::min(kBf16Depth, in_channels - k) / 2,
                                           panel + k * kVectors * kBf16Lanes, nn::kernels::NothingAhead{});
  }
}

}  // namespace

void multiply_bf16_pairs(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                         const std::uint16_t* packed, float* out, std::int64_t out_channels) {
  for (std::int64_t first = 0; first < out_channels; first += kPanelColumns) {
    const std::int64_t columns = std::min(kPanelColumns, out_channels - first);
    const auto multiply = [&](auto panel) { panel(pairs, in, in_channels, packed, out + first, out_channels); };
    switch (columns / kBf16Lanes) {
      case 1:
        multiply(multiply_panel<1>);
        break;
      case 2:
        multiply(multiply_panel<2>);
        break;
      case 3:
        multiply(multiply_panel<3>);
        break;
      default:
        multiply(multiply_panel<4>);
        break;
    }
    packed += in_channels * columns;
  }
}
ANIGEN_BF16_END

#else

void multiply_bf16_pairs(const RowPairs&, const std::uint16_t*, std::int64_t, const std::uint16_t*, float*,
                         std::int64_t) {
  std::abort();  // has_bf16_products() said so
}

#endif

}  // namespace anigen::sparse::kernels
