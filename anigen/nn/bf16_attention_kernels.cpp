#include "anigen/nn/bf16_attention_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "anigen/nn/bf16_tile.h"

namespace anigen::nn::kernels {
namespace {

constexpr std::int64_t kLanes = kBf16Lanes;
constexpr std::int64_t kPanel = 64;      // keys of a panel: four vectors of scores
constexpr std::int64_t kKeyBlock = 256;  // keys whose scores are in flight
static_assert(kBf16QueryTile == kBf16TileRows && kBf16QueryBlock % kBf16QueryTile == 0, "whole tiles");

std::int64_t whole(std::int64_t count, std::int64_t step) { return (count + step - 1) / step * step; }
std::int64_t padded_keys(std::int64_t count) { return whole(count, kLanes); }

}  // namespace

bool bf16_attention_takes(std::int64_t channels) {
  return channels % kLanes == 0 && channels > 0 && channels <= kPanel;
}

std::int64_t packed_bf16_size(std::int64_t count, std::int64_t channels) { return padded_keys(count) * channels; }

std::int64_t bf16_scratch_floats(std::int64_t channels) {
  // Scores, weights in half as many, sums, largest score, sum of weights and factor of each row.
  return kBf16QueryBlock * (kKeyBlock + kKeyBlock / 2 + channels + 3);
}

std::int64_t bf16_asking_calls(std::int64_t queries, std::int64_t keys, std::int64_t channels) {
  const auto steps = [](std::int64_t pairs) { return (pairs + kBf16AskingPairs - 1) / kBf16AskingPairs; };
  const std::int64_t tiles = (queries + kBf16QueryTile - 1) / kBf16QueryTile;
  return tiles * ((keys + kPanel - 1) / kPanel * steps(channels / 2) + steps((keys + 1) / 2));
}

#if ANIGEN_BF16_X86
ANIGEN_BF16_BEGIN
namespace {

// Rows and columns of 16 × 16 numbers of 32 bits change places.
ANIGEN_BF16_INLINE void transpose(__m512i (&r)[kLanes]) {
  __m512i t[kLanes];
#pragma GCC unroll 8
  for (int i = 0; i < 16; i += 2) {
    t[i] = _mm512_unpacklo_epi32(r[i], r[i + 1]);
    t[i + 1] = _mm512_unpackhi_epi32(r[i], r[i + 1]);
  }
#pragma GCC unroll 4
  for (int i = 0; i < 16; i += 4) {
    r[i] = _mm512_unpacklo_epi64(t[i], t[i + 2]);
    r[i + 1] = _mm512_unpackhi_epi64(t[i], t[i + 2]);
    r[i + 2] = _mm512_unpacklo_epi64(t[i + 1], t[i + 3]);
    r[i + 3] = _mm512_unpackhi_epi64(t[i + 1], t[i + 3]);
  }
  // Lane l of r[4 i + j] now is column 4 l + j of rows 4 i to 4 i + 3.
#pragma GCC unroll 4
  for (int j = 0; j < 4; ++j) {
    t[j] = _mm512_shuffle_i32x4(r[j], r[4 + j], 0x88);
    t[4 + j] = _mm512_shuffle_i32x4(r[j], r[4 + j], 0xdd);
    t[8 + j] = _mm512_shuffle_i32x4(r[8 + j], r[12 + j], 0x88);
    t[12 + j] = _mm512_shuffle_i32x4(r[8 + j], r[12 + j], 0xdd);
  }
#pragma GCC unroll 4
  for (int j = 0; j < 4; ++j) {
    r[j] = _mm512_shuffle_i32x4(t[j], t[8 + j], 0x88);
    r[8 + j] = _mm512_shuffle_i32x4(t[j], t[8 + j], 0xdd);
    r[4 + j] = _mm512_shuffle_i32x4(t[4 + j], t[12 + j], 0x88);
    r[12 + j] = _mm512_shuffle_i32x4(t[4 + j], t[12 + j], 0xdd);
  }
}

// e^t, 0 below -87, NaN for NaN and +inf; coefficients of Cephes' expf.
ANIGEN_BF16_INLINE __m512 exp_vector(__m512 t) {
  t = _mm512_max_ps(_mm512_set1_ps(-87.0F), t);  // returns the second for NaN
  const __m512 n = _mm512_roundscale_ps(_mm512_mul_ps(t, _mm512_set1_ps(1.44269504088896341F)), 8);
  __m512 r = _mm512_fnmadd_ps(n, _mm512_set1_ps(0.693359375F), t);
  r = _mm512_fnmadd_ps(n, _mm512_set1_ps(-2.12194440e-4F), r);
  __m512 p = _mm512_set1_ps(1.9875691500e-4F);
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(1.3981999507e-3F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(8.3334519073e-3F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(4.1665795894e-2F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(1.6666665459e-1F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(5.0000001201e-1F));
  p = _mm512_fmadd_ps(p, _mm512_mul_ps(r, r), _mm512_add_ps(r, _mm512_set1_ps(1.0F)));
  return _mm512_scalef_ps(p, n);
}

struct RowState {
  float *largest, *sum, *shrink;
};

// Scores of a block become weights exp(scale (score − largest)) in bf16, and the state of the rows takes them in.
// @param columns a multiple of 32
ANIGEN_BF16_INLINE void softmax_rows(float* scores, std::uint16_t* weights, std::int64_t rows, std::int64_t columns,
                                     float scale, const RowState& state) {
  const __m512 factor = _mm512_set1_ps(scale);
  for (std::int64_t r = 0; r < rows; ++r, scores += kKeyBlock, weights += kKeyBlock) {
    __m512 top = _mm512_set1_ps(state.largest[r]);
    for (std::int64_t c = 0; c < columns; c += kLanes) top = _mm512_max_ps(top, _mm512_loadu_ps(scores + c));
    const float largest = _mm512_reduce_max_ps(top);
    const __m512 shift = _mm512_set1_ps(-scale * largest);
    __m512 sum_a = _mm512_setzero_ps(), sum_b = _mm512_setzero_ps();
    for (std::int64_t c = 0; c < columns; c += 2 * kLanes) {
      const __m512 a = exp_vector(_mm512_fmadd_ps(_mm512_loadu_ps(scores + c), factor, shift));
      const __m512 b = exp_vector(_mm512_fmadd_ps(_mm512_loadu_ps(scores + c + kLanes), factor, shift));
      sum_a = _mm512_add_ps(sum_a, a);
      sum_b = _mm512_add_ps(sum_b, b);
      _mm512_storeu_si512(weights + c, reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(b, a)));
    }
    const float before = scale * (state.largest[r] - largest);
    state.shrink[r] = before < -87.0F ? 0.0F : std::exp(before);
    state.largest[r] = largest;
    state.sum[r] = state.sum[r] * state.shrink[r] + _mm512_reduce_add_ps(_mm512_add_ps(sum_a, sum_b));
  }
}

template <int kVectors>
ANIGEN_BF16 void attend_rows(const Bf16Keys& head, const std::uint16_t* q, std::int64_t q_stride, std::int64_t rows,
                             std::uint16_t* out, std::int64_t out_stride, float* log_sums, float* scratch,
                             products::RowsAhead& ahead) {
  constexpr std::int64_t channels = kVectors * kLanes;
  float* const scores = scratch;
  auto* const weights = reinterpret_cast<std::uint16_t*>(scores + kBf16QueryBlock * kKeyBlock);
  float* const sums = scores + kBf16QueryBlock * (kKeyBlock + kKeyBlock / 2);
  float* const rest = sums + kBf16QueryBlock * channels;
  const RowState state{rest, rest + kBf16QueryBlock, rest + 2 * kBf16QueryBlock};
  std::fill_n(state.largest, rows, -std::numeric_limits<float>::infinity());
  std::fill_n(state.sum, rows, 0.0F);
  for (std::int64_t first = 0; first < head.count; first += kKeyBlock) {
    const std::int64_t keys = std::min(kKeyBlock, head.count - first), columns = padded_keys(keys);
    for (std::int64_t key = 0; key < columns; key += kPanel) {
      const std::uint16_t* const panel = head.keys + (first + key) * channels;
      const auto from = [=](std::int64_t r) { return q + r * q_stride; };
      const auto to = [=](std::int64_t r) { return scores + r * kKeyBlock + key; };
      switch ((columns - key) / kLanes) {
        case 1:
          bf16_rows<1, false>(from, to, rows, channels / 2, panel, ahead);
          break;
        case 2:
          bf16_rows<2, false>(from, to, rows, channels / 2, panel, ahead);
          break;
        case 3:
          bf16_rows<3, false>(from, to, rows, channels / 2, panel, ahead);
          break;
        default:
          bf16_rows<4, false>(from, to, rows, channels / 2, panel, ahead);
      }
    }
    const std::int64_t weighed = whole(keys, 2 * kLanes);
    for (std::int64_t r = 0; keys < weighed && r < rows; ++r) {
      std::fill(scores + r * kKeyBlock + keys, scores + r * kKeyBlock + weighed,
                -std::numeric_limits<float>::infinity());
    }
    softmax_rows(scores, weights, rows, weighed, head.scale, state);
    for (std::int64_t r = 0; first > 0 && r < rows; ++r) {
      const __m512 shrink = _mm512_set1_ps(state.shrink[r]);
      for (int v = 0; v < kVectors; ++v) {
        float* const place = sums + r * channels + v * kLanes;
        _mm512_storeu_ps(place, _mm512_mul_ps(_mm512_loadu_ps(place), shrink));
      }
    }
    const auto weights_of = [=](std::int64_t r) { return weights + r * kKeyBlock; };
    const auto sums_of = [=](std::int64_t r) { return sums + r * channels; };
    if (first == 0) {
      bf16_rows<kVectors, false>(weights_of, sums_of, rows, (keys + 1) / 2, head.values, ahead);
    } else {
      bf16_rows<kVectors, true>(weights_of, sums_of, rows, (keys + 1) / 2, head.values + first * channels, ahead);
    }
  }
  for (std::int64_t r = 0; r < rows; ++r) {
    // As the scores of a row that is not finite leave NaN here, they do everywhere.
    const __m512 factor = _mm512_set1_ps(1.0F / state.sum[r]);
    for (int v = 0; v < kVectors; ++v) {
      const __m256bh row = _mm512_cvtneps_pbh(_mm512_mul_ps(_mm512_loadu_ps(sums + r * channels + v * kLanes), factor));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + r * out_stride + v * kLanes),
                          reinterpret_cast<__m256i>(row));
    }
    log_sums[r] = head.scale * state.largest[r] + std::log(state.sum[r]);
  }
}

}  // namespace

ANIGEN_BF16 void pack_bf16_keys(const std::uint16_t* rows, std::int64_t stride, std::int64_t count,
                                std::int64_t channels, std::uint16_t* packed) {
  const std::int64_t padded = padded_keys(count), pairs = channels / 2;
  for (std::int64_t panel = 0; panel < padded; panel += kPanel) {
    const std::int64_t width = std::min(kPanel, padded - panel);
    // [pairs, width] numbers of 32 bits, of which the rows are the columns.
    for (std::int64_t first = 0; first < width; first += kLanes) {
      for (std::int64_t pair = 0; pair < pairs; pair += kLanes) {
        const auto taken = static_cast<__mmask16>(pairs - pair < kLanes ? (1 << (pairs - pair)) - 1 : 0xffff);
        __m512i block[kLanes];
#pragma GCC unroll 16
        for (int i = 0; i < kLanes; ++i) {
          const std::int64_t key = panel + first + i;
          block[i] =
              key < count ? _mm512_maskz_loadu_epi32(taken, rows + key * stride + 2 * pair) : _mm512_setzero_si512();
        }
        transpose(block);
        for (int i = 0; i < kLanes && pair + i < pairs; ++i) {
          _mm512_storeu_si512(packed + 2 * ((pair + i) * width + first), block[i]);
        }
      }
    }
    packed += width * channels;
  }
}

ANIGEN_BF16 void pack_bf16_values(const std::uint16_t* rows, std::int64_t stride, std::int64_t count,
                                  std::int64_t channels, std::uint16_t* packed) {
  static constexpr std::uint16_t kZeros[kPanel] = {};  // bf16_attention_takes() bounds the channels
  const auto row = [&](std::int64_t key) { return key < count ? rows + key * stride : kZeros; };
  for (std::int64_t key = 0; key < padded_keys(count); key += 2) {
    const std::uint16_t *const even = row(key), *const odd = row(key + 1);
    for (std::int64_t c = 0; c < channels; c += kLanes, packed += 2 * kLanes) {
      const __m512i low = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(even + c)));
      const __m512i high = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(odd + c)));
      _mm512_storeu_si512(packed, _mm512_or_si512(low, _mm512_slli_epi32(high, 16)));
    }
  }
}

void attend_bf16(const Bf16Keys& head, const std::uint16_t* q, std::int64_t q_stride, std::int64_t rows,
                 std::uint16_t* out, std::int64_t out_stride, float* log_sums, float* scratch,
                 products::RowsAhead& ahead) {
  switch (head.channels / kLanes) {
    case 1:
      return attend_rows<1>(head, q, q_stride, rows, out, out_stride, log_sums, scratch, ahead);
    case 2:
      return attend_rows<2>(head, q, q_stride, rows, out, out_stride, log_sums, scratch, ahead);
    case 3:
      return attend_rows<3>(head, q, q_stride, rows, out, out_stride, log_sums, scratch, ahead);
    default:
      return attend_rows<4>(head, q, q_stride, rows, out, out_stride, log_sums, scratch, ahead);
  }
}
ANIGEN_BF16_END

#else

void pack_bf16_keys(const std::uint16_t*, std::int64_t, std::int64_t, std::int64_t, std::uint16_t*) { std::abort(); }

void pack_bf16_values(const std::uint16_t*, std::int64_t, std::int64_t, std::int64_t, std::uint16_t*) { std::abort(); }

void attend_bf16(const Bf16Keys&, const std::uint16_t*, std::int64_t, std::int64_t, std::uint16_t*, std::int64_t,
                 float*, float*, products::RowsAhead&) {
  std::abort();  // has_bf16_products() said so
}

#endif

}  // namespace anigen::nn::kernels
