#include "anigen/nn/kernels/attention_bf16.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

#include "anigen/nn/kernels/aligned_vector.h"
#include "anigen/nn/kernels/bf16_products.h"
#include "anigen/nn/kernels/heads.h"
#include "anigen/nn/kernels/mixed_products.h"

namespace anigen::nn {

#if ANIGEN_BF16_X86

namespace {

ANIGEN_BF16_BEGIN
// Rows and columns of 16 × 16 numbers of 32 bits change places.
ANIGEN_BF16_INLINE void transpose(__m512i (&r)[kernels::kBf16Lanes]) {
  __m512i t[kernels::kBf16Lanes];
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

ANIGEN_BF16_END

}  // namespace

ANIGEN_BF16_BEGIN
ANIGEN_BF16 void pack_bf16_keys(const std::uint16_t* rows, std::int64_t stride, std::int64_t count,
                                std::int64_t channels, std::uint16_t* packed) {
  const std::int64_t padded = padded_keys(count), pairs = channels / 2;
  for (std::int64_t panel = 0; panel < padded; panel += kBf16Panel) {
    const std::int64_t width = std::min(kBf16Panel, padded - panel);
    // [pairs, width] numbers of 32 bits, of which the rows are the columns.
    for (std::int64_t first = 0; first < width; first += kernels::kBf16Lanes) {
      for (std::int64_t pair = 0; pair < pairs; pair += kernels::kBf16Lanes) {
        const auto taken =
            static_cast<__mmask16>(pairs - pair < kernels::kBf16Lanes ? (1 << (pairs - pair)) - 1 : 0xffff);
        __m512i block[kernels::kBf16Lanes];
#pragma GCC unroll 16
        for (int i = 0; i < kernels::kBf16Lanes; ++i) {
          const std::int64_t key = panel + first + i;
          block[i] =
              key < count ? _mm512_maskz_loadu_epi32(taken, rows + key * stride + 2 * pair) : _mm512_setzero_si512();
        }
        transpose(block);
        for (int i = 0; i < kernels::kBf16Lanes && pair + i < pairs; ++i)
          _mm512_storeu_si512(packed + 2 * ((pair + i) * width + first), block[i]);
      }
    }
    packed += width * channels;
  }
}

ANIGEN_BF16 void pack_bf16_values(const std::uint16_t* rows, std::int64_t stride, std::int64_t count,
                                  std::int64_t channels, std::uint16_t* packed) {
  static constexpr std::uint16_t kZeros[kBf16Panel] = {};  // prefers_bf16_attention() bounds the channels
  const auto row = [&](std::int64_t key) { return key < count ? rows + key * stride : kZeros; };
  for (std::int64_t key = 0; key < padded_keys(count); key += 2) {
    const std::uint16_t *const even = row(key), *const odd = row(key + 1);
    for (std::int64_t c = 0; c < channels; c += kernels::kBf16Lanes, packed += 2 * kernels::kBf16Lanes) {
      const __m512i low = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(even + c)));
      const __m512i high = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(odd + c)));
      _mm512_storeu_si512(packed, _mm512_or_si512(low, _mm512_slli_epi32(high, 16)));
    }
  }
}
ANIGEN_BF16_END

#else

void pack_bf16_keys(const std::uint16_t*, std::int64_t, std::int64_t, std::int64_t, std::uint16_t*) { std::abort(); }

void pack_bf16_values(const std::uint16_t*, std::int64_t, std::int64_t, std::int64_t, std::uint16_t*) { std::abort(); }

#endif

namespace {

// Attention of one head in bf16, where has_bf16_products() says so: products of bf16 numbers are exact and added up in
// fp32, the softmax is fp32, its weights are rounded to bf16 before they meet the values. bf16 numbers are passed as
// their 16 bits. Packing needs the same processor.
struct Bf16Keys {
  const std::uint16_t* keys;    // of pack_bf16_keys
  const std::uint16_t* values;  // of pack_bf16_values
  std::int64_t count, channels;
  float scale;  // of the scores
};

constexpr std::int64_t kBf16QueryBlock = 96;  // rows that attend_bf16 takes at most
constexpr std::int64_t kAmxQueryBlock = 32;   // rows of two tiles, whose scores stay in the first-level cache
constexpr std::int64_t kBf16QueryTile = 6;    // rows that are computed together: a multiple of it wastes nothing
constexpr std::int64_t kKeyBlock = 256;       // keys whose scores are in flight
static_assert(kBf16QueryTile == kernels::kBf16TileRows && kBf16QueryBlock % kBf16QueryTile == 0, "whole tiles");

// 16-bit numbers of packed keys, and as many of packed values.
std::int64_t packed_bf16_size(std::int64_t count, std::int64_t channels) { return padded_keys(count) * channels; }

std::int64_t bf16_scratch_floats(std::int64_t channels) {
  // Scores, weights in half as many, sums, largest score, sum of weights and factor of each row.
  return kBf16QueryBlock * (kKeyBlock + kKeyBlock / 2 + channels + 3);
}

std::int64_t bf16_asking_calls(std::int64_t queries, std::int64_t keys, std::int64_t channels) {
  const auto steps = [](std::int64_t pairs) {
    return (pairs + kernels::kBf16AskingPairs - 1) / kernels::kBf16AskingPairs;
  };
  const std::int64_t tiles = (queries + kBf16QueryTile - 1) / kBf16QueryTile;
  return tiles * ((keys + kBf16Panel - 1) / kBf16Panel * steps(channels / 2) + steps((keys + 1) / 2));
}

#if ANIGEN_BF16_X86
ANIGEN_BF16_BEGIN
// 2^t to 3e-6 of it, exactly 1 at 0, about 0 below -126; NaN for NaN. A polynomial of least relative error for the
// fraction of t: its results are rounded to bf16, 2^-8 of them.
ANIGEN_BF16_INLINE __m512 exp2_vector(__m512 t) {
  t = _mm512_max_ps(_mm512_set1_ps(-126.0F), t);  // returns the second for NaN
  const __m512 n = _mm512_roundscale_ps(t, 8), r = _mm512_sub_ps(t, n);
  __m512 p = _mm512_set1_ps(9.582848195e-3F);
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(5.590642515e-2F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(2.402409869e-1F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(6.931241934e-1F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(1.0F));
  return _mm512_scalef_ps(p, n);
}

constexpr float kLog2E = 1.44269504088896341F;

struct RowState {
  float *largest, *sum, *shrink;
};

// Scores of a block become weights exp(scale (score − largest)) in bf16, and the state of the rows takes them in.
// @param columns a multiple of 32
ANIGEN_BF16_INLINE void softmax_rows(float* scores, std::uint16_t* weights, std::int64_t rows, std::int64_t columns,
                                     float scale, const RowState& state) {
  const __m512 factor = _mm512_set1_ps(kLog2E * scale);
  for (std::int64_t r = 0; r < rows; ++r, scores += kKeyBlock, weights += kKeyBlock) {
    __m512 top = _mm512_set1_ps(state.largest[r]);
    for (std::int64_t c = 0; c < columns; c += kernels::kBf16Lanes)
      top = _mm512_max_ps(top, _mm512_loadu_ps(scores + c));
    const float largest = _mm512_reduce_max_ps(top);
    const __m512 shift = _mm512_set1_ps(-(kLog2E * scale) * largest);
    __m512 sum_a = _mm512_setzero_ps(), sum_b = _mm512_setzero_ps();
    for (std::int64_t c = 0; c < columns; c += 2 * kernels::kBf16Lanes) {
      const __m512 a = exp2_vector(_mm512_fmadd_ps(_mm512_loadu_ps(scores + c), factor, shift));
      const __m512 b = exp2_vector(_mm512_fmadd_ps(_mm512_loadu_ps(scores + c + kernels::kBf16Lanes), factor, shift));
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

ANIGEN_BF16_INLINE void store_row(float* out, __m512 numbers) { _mm512_storeu_ps(out, numbers); }

ANIGEN_BF16_INLINE void store_row(std::uint16_t* out, __m512 numbers) {
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), reinterpret_cast<__m256i>(_mm512_cvtneps_pbh(numbers)));
}

template <int kVectors, typename Out>
ANIGEN_BF16 void attend_rows(const Bf16Keys& head, const std::uint16_t* q, std::int64_t q_stride, std::int64_t rows,
                             Out* out, std::int64_t out_stride, float* log_sums, float* scratch,
                             products::RowsAhead& ahead) {
  constexpr std::int64_t kChannels = kVectors * kernels::kBf16Lanes;
  float* const scores = scratch;
  auto* const weights = reinterpret_cast<std::uint16_t*>(scores + kBf16QueryBlock * kKeyBlock);
  float* const sums = scores + kBf16QueryBlock * (kKeyBlock + kKeyBlock / 2);
  float* const rest = sums + kBf16QueryBlock * kChannels;
  const RowState state{rest, rest + kBf16QueryBlock, rest + 2 * kBf16QueryBlock};
  kernels::Bf16Multiplier multiplier;
  std::fill_n(state.largest, rows, -std::numeric_limits<float>::infinity());
  std::fill_n(state.sum, rows, 0.0F);
  for (std::int64_t first = 0; first < head.count; first += kKeyBlock) {
    const std::int64_t keys = std::min(kKeyBlock, head.count - first), columns = padded_keys(keys);
    for (std::int64_t key = 0; key < columns; key += kBf16Panel) {
      const std::uint16_t* const panel = head.keys + (first + key) * kChannels;
      multiplier.multiply({q, q_stride, panel, scores + key, kKeyBlock, rows, kChannels / 2,
                           std::min(kBf16Panel, columns - key) / kernels::kBf16Lanes},
                          /*adds=*/false, ahead);
    }
    const std::int64_t weighed = padded_keys(keys, 2 * kernels::kBf16Lanes);
    for (std::int64_t r = 0; keys < weighed && r < rows; ++r) {
      std::fill(scores + r * kKeyBlock + keys, scores + r * kKeyBlock + weighed,
                -std::numeric_limits<float>::infinity());
    }
    softmax_rows(scores, weights, rows, weighed, head.scale, state);
    for (std::int64_t r = 0; first > 0 && r < rows; ++r) {
      const __m512 shrink = _mm512_set1_ps(state.shrink[r]);
      for (int v = 0; v < kVectors; ++v) {
        float* const place = sums + r * kChannels + v * kernels::kBf16Lanes;
        _mm512_storeu_ps(place, _mm512_mul_ps(_mm512_loadu_ps(place), shrink));
      }
    }
    multiplier.multiply(
        {weights, kKeyBlock, head.values + first * kChannels, sums, kChannels, rows, (keys + 1) / 2, kVectors},
        /*adds=*/first > 0, ahead);
  }
  for (std::int64_t r = 0; r < rows; ++r) {
    // As the scores of a row that is not finite leave NaN here, they do everywhere.
    const __m512 factor = _mm512_set1_ps(1.0F / state.sum[r]);
    for (int v = 0; v < kVectors; ++v) {
      store_row(out + r * out_stride + v * kernels::kBf16Lanes,
                _mm512_mul_ps(_mm512_loadu_ps(sums + r * kChannels + v * kernels::kBf16Lanes), factor));
    }
    log_sums[r] = head.scale * state.largest[r] + std::log(state.sum[r]);
  }
}

// out[r, :] = softmax(scale q[r, :] keysᵀ) values, and the log-sum-exp of the scaled scores of each row. A row with
// scores that are not finite becomes NaN.
// @param q [rows, channels], rows `q_stride` apart @param out rows `out_stride` apart @param ahead asked
// bf16_asking_calls times, evenly over the products
template <typename Out>
void attend_bf16(const Bf16Keys& head, const std::uint16_t* q, std::int64_t q_stride, std::int64_t rows, Out* out,
                 std::int64_t out_stride, float* log_sums, float* scratch, products::RowsAhead& ahead) {
  using Form = decltype(&attend_rows<1, Out>);
  static constexpr Form kForms[] = {attend_rows<1, Out>, attend_rows<2, Out>, attend_rows<3, Out>, attend_rows<4, Out>};
  const Form attend_block = kForms[head.channels / kernels::kBf16Lanes - 1];
  const std::int64_t block = kernels::has_amx_products() ? kAmxQueryBlock : kBf16QueryBlock;
  for (std::int64_t r = 0; r < rows; r += block) {
    attend_block(head, q + r * q_stride, q_stride, std::min(block, rows - r), out + r * out_stride, out_stride,
                 log_sums + r, scratch, ahead);
  }
}
ANIGEN_BF16_END

#else

template <typename Out>
void attend_bf16(const Bf16Keys&, const std::uint16_t*, std::int64_t, std::int64_t, Out*, std::int64_t, float*, float*,
                 products::RowsAhead&) {
  std::abort();  // has_bf16_products() said so
}

#endif

// The rows of a head as bits. @param heads_at which axis of the tensor counts heads
struct Bf16HeadRows {
  Bf16HeadRows(const Tensor& x, std::int64_t index, std::int64_t heads, int heads_at)
      : data(bf16_bits(x) + index / heads * x.stride(0) + index % heads * x.stride(heads_at)),
        stride(x.stride(3 - heads_at)) {}
  std::uint16_t* data;
  std::int64_t stride;
};

std::uint16_t* row_of(const Tensor& x, std::int64_t head, std::int64_t row) {
  return bf16_bits(x) + head * x.stride(1) + row * x.stride(0);
}

// Queries of a task: a window of 8³ on a surface has up to 140 voxels.
constexpr std::int64_t kTaskQueries = 192;
constexpr std::int64_t kOwnKeys = 1024;  // as packed, 256 KiB with 64 channels

// A sequence whose queries make one task: the task packs its keys itself, and they never leave the cache.
bool is_one_task(const RaggedProblem& problem, std::int64_t sequence) {
  return problem.queries(sequence) <= kTaskQueries && problem.keys(sequence) <= kOwnKeys;
}

// Keys and values of one head of a sequence as the kernels read them.
void pack(const RaggedProblem& problem, const Tensor& k, const Tensor& v, std::int64_t sequence, std::int64_t head,
          std::uint16_t* keys, std::uint16_t* values) {
  const std::int64_t first = problem.k_offsets[sequence], count = problem.keys(sequence), channels = problem.channels;
  pack_bf16_keys(row_of(k, head, first), k.stride(0), count, channels, keys);
  pack_bf16_values(row_of(v, head, first), v.stride(0), count, channels, values);
}

// Those of all heads of the sequences that several tasks share.
class PackedSequences {
 public:
  PackedSequences(const RaggedProblem& problem, const Tensor& k, const Tensor& v)
      : heads_(problem.heads), starts_(static_cast<std::size_t>(problem.sequences) + 1, 0) {
    for (std::int64_t s = 0; s < problem.sequences; ++s) {
      const bool shared = !is_one_task(problem, s);
      starts_[static_cast<std::size_t>(s) + 1] =
          start(s) + (shared ? packed_bf16_size(problem.keys(s), problem.channels) : 0);
    }
    numbers_ = torch::empty({2, heads_ * starts_.back()}, torch::kInt16);
    at::parallel_for(0, problem.sequences, 1, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t s = begin; s < end; ++s) {
        if (is_one_task(problem, s)) continue;
        for (std::int64_t head = 0; head < heads_; ++head)
          pack(problem, k, v, s, head, place(0, s, head), place(1, s, head));
      }
    });
  }
  std::uint16_t* place(std::int64_t part, std::int64_t sequence, std::int64_t head) const {
    const std::int64_t length = start(sequence + 1) - start(sequence);
    return reinterpret_cast<std::uint16_t*>(numbers_.data_ptr<std::int16_t>()) +
           heads_ * (part * starts_.back() + start(sequence)) + head * length;
  }

 private:
  std::int64_t start(std::int64_t sequence) const { return starts_[static_cast<std::size_t>(sequence)]; }

  std::int64_t heads_;
  std::vector<std::int64_t> starts_;  // of one head
  Tensor numbers_;
};

// Numbers of packed keys of the longest sequence that is one task.
std::int64_t longest_own(const RaggedProblem& problem) {
  std::int64_t longest = 0;
  for (std::int64_t s = 0; s < problem.sequences; ++s) {
    if (is_one_task(problem, s)) longest = std::max(longest, problem.keys(s));
  }
  return packed_bf16_size(longest, problem.channels);
}

// Queries that the kernels take at a time: about equally many each, in whole tiles.
std::int64_t query_block(std::int64_t queries) {
  const std::int64_t even = even_block(queries, kBf16QueryBlock), tile = kBf16QueryTile;
  return (even + tile - 1) / tile * tile;
}

struct Bf16Scratch {
  explicit Bf16Scratch(const RaggedProblem& problem)
      : floats(torch::empty({bf16_scratch_floats(problem.channels)}, torch::kFloat32)),
        numbers(torch::empty({2, longest_own(problem)}, torch::kInt16)) {}
  std::uint16_t* own(std::int64_t part) const {
    return reinterpret_cast<std::uint16_t*>(numbers.data_ptr<std::int16_t>()) + part * numbers.size(1);
  }
  Tensor floats, numbers;
};

// Memory that the next part reads first and writes, to be asked for during the products of this one.
products::RowsAhead rows_after(const RaggedProblem& problem, const HeadTask& part, const HeadTask& next,
                               const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& out) {
  products::RowsAhead ahead;
  if (next.task == nullptr) return ahead;
  const std::int64_t sequence = next.task->sequence, row = problem.q_offsets[sequence] + next.task->first_query;
  const auto add = [&](const Tensor& x, std::int64_t first, std::int64_t count) {
    add_rows(ahead, HeadRows<c10::BFloat16>(x, next.head, first), count, problem.channels);
  };
  if (is_one_task(problem, sequence)) {  // others have packed theirs
    add(k, problem.k_offsets[sequence], problem.keys(sequence));
    add(v, problem.k_offsets[sequence], problem.keys(sequence));
  }
  add(q, row, next.task->queries);
  if (dtype_of(out) == torch::kFloat32) {
    add_rows(ahead, HeadRows<float>(out, next.head, row), next.task->queries, problem.channels);
  } else {
    add(out, row, next.task->queries);
  }
  ahead.spread_over(bf16_asking_calls(part.task->queries, problem.keys(part.task->sequence), problem.channels));
  return ahead;
}

}  // namespace

namespace {

bool suits_bf16(const Tensor& q) {
  return q.is_cpu() && q.size(-1) > 0 && q.size(-1) <= kBf16Panel && q.size(-1) % kernels::kBf16Lanes == 0;
}

}  // namespace

bool prefers_bf16_attention(const Tensor& q) {
  return dtype_of(q) == torch::kBFloat16 && suits_bf16(q) && kernels::has_bf16_products();
}

bool prefers_mixed_attention(const Tensor& q) {
  return dtype_of(q) == torch::kFloat32 && suits_bf16(q) && mixed_products();
}

Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums) {
  const std::int64_t batch = q.size(0), heads = q.size(1), queries = q.size(2), keys = k.size(2), channels = q.size(3);
  const std::int64_t size = packed_bf16_size(keys, channels), all = batch * heads;
  const Tensor packed = torch::empty({2, all, size}, torch::kInt16);
  auto* const packed_keys = reinterpret_cast<std::uint16_t*>(packed.data_ptr<std::int16_t>());
  std::uint16_t* const packed_values = packed_keys + all * size;
  at::parallel_for(0, all, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t head = begin; head < end; ++head) {
      const Bf16HeadRows from_k(k, head, heads, 1), from_v(v, head, heads, 1);
      pack_bf16_keys(from_k.data, from_k.stride, keys, channels, packed_keys + head * size);
      pack_bf16_values(from_v.data, from_v.stride, keys, channels, packed_values + head * size);
    }
  });
  const Tensor out = torch::empty({batch, queries, heads, channels}, q.options());
  float* const sums = log_sums.data_ptr<float>();
  const auto scale = static_cast<float>(1.0 / std::sqrt(static_cast<double>(channels)));
  const std::int64_t blocks = (queries + kBf16QueryBlock - 1) / kBf16QueryBlock;
  at::parallel_for(0, all * blocks, 1, [&](std::int64_t begin, std::int64_t end) {
    kernels::AlignedVector<float> scratch(static_cast<std::size_t>(bf16_scratch_floats(channels)));
    products::RowsAhead nothing;
    for (std::int64_t item = begin; item < end; ++item) {
      const std::int64_t head = item / blocks, first = item % blocks * kBf16QueryBlock;
      const Bf16HeadRows from(q, head, heads, 1), to(out, head, heads, 2);
      attend_bf16({packed_keys + head * size, packed_values + head * size, keys, channels, scale},
                  from.data + first * from.stride, from.stride, std::min(kBf16QueryBlock, queries - first),
                  to.data + first * to.stride, to.stride, sums + head * queries + first, scratch.data(), nothing);
    }
  });
  return out;
}

void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums) {
  const PackedSequences packed(problem, k, v);
  for_each_head<Bf16Scratch>(
      problem, ragged_tasks(problem, kTaskQueries),
      [&](const HeadTask& part, const HeadTask& next, const Bf16Scratch& scratch) {
        const std::int64_t sequence = part.task->sequence, head = part.head, block = query_block(part.task->queries);
        const bool own = is_one_task(problem, sequence);
        if (own) pack(problem, k, v, sequence, head, scratch.own(0), scratch.own(1));
        const Bf16Keys keys{own ? scratch.own(0) : packed.place(0, sequence, head),
                            own ? scratch.own(1) : packed.place(1, sequence, head), problem.keys(sequence),
                            problem.channels, problem.scale};
        products::RowsAhead ahead = rows_after(problem, part, next, q, k, v, out);
        for (std::int64_t first = 0; first < part.task->queries; first += block) {
          const std::int64_t row = problem.q_offsets[sequence] + part.task->first_query + first;
          const auto attend_to = [&](auto* to) {
            attend_bf16(keys, row_of(q, head, row), q.stride(0), std::min(block, part.task->queries - first),
                        to + head * out.stride(1) + row * out.stride(0), out.stride(0),
                        log_sums.data_ptr<float>() + head * problem.rows + row, scratch.floats.data_ptr<float>(),
                        ahead);
          };
          if (dtype_of(out) == torch::kFloat32) {
            attend_to(out.data_ptr<float>());
          } else {
            attend_to(bf16_bits(out));
          }
        }
      });
}

}  // namespace anigen::nn
