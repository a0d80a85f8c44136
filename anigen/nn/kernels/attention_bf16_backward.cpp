// The backward pass of attention whose factors are rounded to bf16 (after Dao et al. 2022, "FlashAttention"): with
// S = Q Kᵀ and the log-sum-exp L of each query's scaled scores,
//   P = exp(s S − L)         dV = Pᵀ dY        dP = dY Vᵀ
//   dS = s P ∘ (dP − δ)      dK = dSᵀ Q        dQ = dS K        with δ = Σ_channels dY ∘ Y.
// Scores are formed with keys as rows, so that Pᵀ and dSᵀ are factors as they come; dS is kept in pairs of keys.
#include <algorithm>
#include <cstdlib>
#include <limits>
#include <utility>

#include "anigen/nn/kernels/attention_bf16.h"
#include "anigen/nn/kernels/bf16_products.h"
#include "anigen/nn/kernels/heads.h"

namespace anigen::nn {

namespace {

constexpr std::int64_t kQueries = 128, kKeys = 256;  // of a block
constexpr std::int64_t kGroup = 24;                  // keys whose scores are in flight: whole tiles and pairs

// One head of a sequence. Rows are a stride apart, that of dq and dk in fp32 numbers.
struct HeadOfSequence {
  const std::uint16_t *q, *k, *v, *dy;
  std::int64_t q_stride, k_stride, v_stride, dy_stride;
  float *dq, *dk, *dv;
  std::int64_t dq_stride, dk_stride;
  const float *log_sums, *delta;
  std::int64_t queries, keys, channels;
  float scale;
};

// Memory of a thread. Pointers are kept: to ask a tensor for them in an inner loop would cost more than its products.
struct MixedScratch {
  explicit MixedScratch(const RaggedProblem& problem)
      : floats(torch::empty({2 * kGroup * kQueries + 2 * kQueries + problem.longest_queries}, torch::kFloat32)),
        numbers(torch::empty({(4 * kQueries + kKeys) * problem.channels + (2 * kGroup + kKeys) * kQueries},
                             torch::kInt16)) {
    float* next_float = floats.data_ptr<float>();
    const auto take_floats = [&](std::int64_t count) { return std::exchange(next_float, next_float + count); };
    scores = take_floats(kGroup * kQueries);
    slopes = take_floats(kGroup * kQueries);
    log_sums = take_floats(kQueries);
    block_delta = take_floats(kQueries);
    delta = take_floats(problem.longest_queries);
    auto* next = reinterpret_cast<std::uint16_t*>(numbers.data_ptr<std::int16_t>());
    const auto take = [&](std::int64_t count) { return std::exchange(next, next + count); };
    q_columns = take(kQueries * problem.channels);
    dy_columns = take(kQueries * problem.channels);
    q_pairs = take(kQueries * problem.channels);
    dy_pairs = take(kQueries * problem.channels);
    key_pairs = take(kKeys * problem.channels);
    weights = take(kGroup * kQueries);
    score_slopes = take(kGroup * kQueries);
    slope_pairs = take(kKeys * kQueries);
  }

  float *scores, *slopes;         // Sᵀ and dPᵀ, [kGroup, kQueries]
  float *log_sums, *block_delta;  // L and δ of a block of queries
  float* delta;                   // δ of all queries
  std::uint16_t *q_columns, *dy_columns, *q_pairs, *dy_pairs, *key_pairs;
  std::uint16_t *weights, *score_slopes;  // Pᵀ and dSᵀ, [kGroup, kQueries]
  std::uint16_t* slope_pairs;             // dS, [kKeys / 2, kQueries, 2]
  Tensor floats, numbers;
};

std::int64_t asking_calls(const HeadOfSequence& head) {
  const std::int64_t tile = kernels::kBf16TileRows, steps = kernels::kBf16AskingPairs;
  const auto calls = [&](std::int64_t rows, std::int64_t pairs) {
    return (rows + tile - 1) / tile * ((pairs + steps - 1) / steps);
  };
  const std::int64_t panels = (head.queries + kBf16Panel - 1) / kBf16Panel;
  return 2 * panels * calls(head.keys, head.channels / 2) + 2 * calls(head.keys, (head.queries + 1) / 2) +
         calls(head.queries, (head.keys + 1) / 2);
}

#if ANIGEN_BF16_X86

ANIGEN_BF16_BEGIN

ANIGEN_BF16_INLINE void store_rounded(std::uint16_t* to, __m512 numbers) {
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), reinterpret_cast<__m256i>(_mm512_cvtneps_pbh(numbers)));
}

// Pᵀ and dSᵀ of two keys. Without a second key its numbers in the pairs are 0.
ANIGEN_BF16_INLINE void weigh_two_keys(const MixedScratch& scratch, std::int64_t row, bool has_second,
                                       std::int64_t columns, float scale, std::uint16_t* slope_pairs) {
  const float *const scores = scratch.scores + row * kQueries, *const slopes = scratch.slopes + row * kQueries;
  std::uint16_t* const weights = scratch.weights + row * kQueries;
  std::uint16_t* const score_slopes = scratch.score_slopes + row * kQueries;
  const __m512 s = _mm512_set1_ps(scale);
  const auto second = static_cast<__mmask16>(has_second ? 0xFFFF : 0);
  for (std::int64_t c = 0; c < columns; c += kernels::kBf16Lanes) {
    const __m512 log_sum = _mm512_loadu_ps(scratch.log_sums + c), delta = _mm512_loadu_ps(scratch.block_delta + c);
    const __m512 score_b = _mm512_maskz_loadu_ps(second, scores + kQueries + c);
    const __m512 slope_b = _mm512_maskz_loadu_ps(second, slopes + kQueries + c);
    const __m512 p_a = kernels::exp_vector(_mm512_fmsub_ps(_mm512_loadu_ps(scores + c), s, log_sum));
    const __m512 p_b = kernels::exp_vector(_mm512_fmsub_ps(score_b, s, log_sum));
    const __m512 ds_a = _mm512_mul_ps(_mm512_mul_ps(s, p_a), _mm512_sub_ps(_mm512_loadu_ps(slopes + c), delta));
    const __m512 ds_b = _mm512_maskz_mul_ps(second, _mm512_mul_ps(s, p_b), _mm512_sub_ps(slope_b, delta));
    store_rounded(weights + c, p_a);
    store_rounded(weights + kQueries + c, p_b);
    store_rounded(score_slopes + c, ds_a);
    store_rounded(score_slopes + kQueries + c, ds_b);
    _mm512_storeu_si512(slope_pairs + 2 * c, kernels::interleaved(ds_a, ds_b));
  }
}

// A block of queries as columns and as pairs. Padded columns have L = δ = 0 and meet rows of zeros.
ANIGEN_BF16_INLINE void pack_queries(const HeadOfSequence& head, const MixedScratch& scratch, std::int64_t first,
                                     std::int64_t rows) {
  const std::uint16_t *const q = head.q + first * head.q_stride, *const dy = head.dy + first * head.dy_stride;
  pack_bf16_keys(q, head.q_stride, rows, head.channels, scratch.q_columns);
  pack_bf16_keys(dy, head.dy_stride, rows, head.channels, scratch.dy_columns);
  pack_bf16_values(q, head.q_stride, rows, head.channels, scratch.q_pairs);
  pack_bf16_values(dy, head.dy_stride, rows, head.channels, scratch.dy_pairs);
  std::copy_n(head.log_sums + first, rows, scratch.log_sums);
  std::copy_n(head.delta + first, rows, scratch.block_delta);
  std::fill(scratch.log_sums + rows, scratch.log_sums + padded_keys(rows), 0.0F);
  std::fill(scratch.block_delta + rows, scratch.block_delta + padded_keys(rows), 0.0F);
}

void add_keys_gradients(const HeadOfSequence& head, const MixedScratch& scratch, std::int64_t key, std::int64_t keys,
                        std::int64_t pairs, bool adds, kernels::Bf16Multiplier& multiplier,
                        products::RowsAhead& ahead) {
  const std::int64_t vectors = head.channels / kernels::kBf16Lanes;
  const auto add = [&](const std::uint16_t* factors, const std::uint16_t* b, float* sums) {
    multiplier.multiply({factors, kQueries, b, sums + key * head.dk_stride, head.dk_stride, keys, pairs, vectors}, adds,
                        ahead);
  };
  add(scratch.weights, scratch.dy_pairs, head.dv);
  add(scratch.score_slopes, scratch.q_pairs, head.dk);
}

template <int kVectors>
ANIGEN_BF16 void mixed_head_backward(const HeadOfSequence& head, const MixedScratch& scratch,
                                     products::RowsAhead& ahead) {
  constexpr std::int64_t kChannels = kVectors * kernels::kBf16Lanes;
  kernels::Bf16Multiplier multiplier;
  for (std::int64_t j = 0; j < head.keys; j += kKeys) {
    const std::int64_t keys = std::min(kKeys, head.keys - j);
    pack_bf16_values(head.k + j * head.k_stride, head.k_stride, keys, kChannels, scratch.key_pairs);
    for (std::int64_t i = 0; i < head.queries; i += kQueries) {
      const std::int64_t rows = std::min(kQueries, head.queries - i), columns = padded_keys(rows);
      if (j == 0 || head.queries > kQueries) pack_queries(head, scratch, i, rows);
      for (std::int64_t g = 0; g < keys; g += kGroup) {
        const std::int64_t group = std::min(kGroup, keys - g);
        for (std::int64_t c = 0; c < columns; c += kBf16Panel) {
          const std::int64_t vectors = std::min(kBf16Panel, columns - c) / kernels::kBf16Lanes;
          const auto score = [&](const std::uint16_t* rows_of_keys, std::int64_t stride,
                                 const std::uint16_t* columns_of, float* to) {
            multiplier.multiply({rows_of_keys + (j + g) * stride, stride, columns_of + c * kChannels, to + c, kQueries,
                                 group, kChannels / 2, vectors},
                                /*adds=*/false, ahead);
          };
          score(head.k, head.k_stride, scratch.q_columns, scratch.scores);
          score(head.v, head.v_stride, scratch.dy_columns, scratch.slopes);
        }
        for (std::int64_t r = 0; r < group; r += 2)
          weigh_two_keys(scratch, r, r + 1 < group, columns, head.scale, scratch.slope_pairs + (g + r) * kQueries);
        add_keys_gradients(head, scratch, j + g, group, columns / 2,
                           /*adds=*/i > 0, multiplier, ahead);
      }
      const auto slope_pairs = [&](std::int64_t r) { return scratch.slope_pairs + 2 * r; };
      const auto dq = [&](std::int64_t r) { return head.dq + (i + r) * head.dq_stride; };
      if (j == 0) {
        kernels::bf16_rows<kVectors, false>(slope_pairs, dq, rows, (keys + 1) / 2, scratch.key_pairs, ahead,
                                            2 * kQueries);
      } else {
        kernels::bf16_rows<kVectors, true>(slope_pairs, dq, rows, (keys + 1) / 2, scratch.key_pairs, ahead,
                                           2 * kQueries);
      }
    }
  }
}

ANIGEN_BF16_END

void backward_of(const HeadOfSequence& head, const MixedScratch& scratch, products::RowsAhead& ahead) {
  switch (head.channels / kernels::kBf16Lanes) {
    case 1:
      return mixed_head_backward<1>(head, scratch, ahead);
    case 2:
      return mixed_head_backward<2>(head, scratch, ahead);
    case 3:
      return mixed_head_backward<3>(head, scratch, ahead);
    default:
      return mixed_head_backward<4>(head, scratch, ahead);
  }
}

#else

void backward_of(const HeadOfSequence&, const MixedScratch&, products::RowsAhead&) {
  std::abort();  // has_bf16_products() said so
}

#endif

// Memory that the next part reads first and writes, to be asked for during the products of this one.
products::RowsAhead rows_of_next(const RaggedProblem& p, const HeadOfSequence& now, const HeadTask& next,
                                 const MixedAttentionGradients& t) {
  products::RowsAhead ahead;
  if (next.task == nullptr) return ahead;
  const std::int64_t row = p.q_offsets[next.task->sequence], key_row = p.k_offsets[next.task->sequence];
  const std::int64_t queries = next.task->queries, keys = std::min(kKeys, p.keys(next.task->sequence));
  const auto add = [&](const auto& rows, std::int64_t count) { add_rows(ahead, rows, count, p.channels); };
  for (const Tensor* x : {&t.dy, &t.out, &t.dq}) add(HeadRows<float>(*x, next.head, row), queries);
  for (const Tensor* x : {&t.q, &t.rounded_dy}) add(HeadRows<c10::BFloat16>(*x, next.head, row), queries);
  for (const Tensor* x : {&t.k, &t.v}) add(HeadRows<c10::BFloat16>(*x, next.head, key_row), keys);
  ahead.spread_over(asking_calls(now));
  return ahead;
}

}  // namespace

void mixed_attention_backward(const RaggedProblem& problem, const MixedAttentionGradients& t) {
  for_each_head<MixedScratch>(
      problem, ragged_tasks(problem, std::numeric_limits<std::int32_t>::max()),
      [&](const HeadTask& part, const HeadTask& next, const MixedScratch& scratch) {
        const std::int64_t sequence = part.task->sequence, head = part.head;
        const std::int64_t row = problem.q_offsets[sequence], key_row = problem.k_offsets[sequence];
        const auto rounded = [&](const Tensor& x, std::int64_t first) {
          return bf16_bits(x) + head * x.stride(1) + first * x.stride(0);
        };
        const auto sums = [&](const Tensor& x, std::int64_t first) {
          return x.data_ptr<float>() + head * x.stride(1) + first * x.stride(0);
        };
        const HeadOfSequence now{rounded(t.q, row),      rounded(t.k, key_row),
                                 rounded(t.v, key_row),  rounded(t.rounded_dy, row),
                                 t.q.stride(0),          t.k.stride(0),
                                 t.v.stride(0),          t.rounded_dy.stride(0),
                                 sums(t.dq, row),        sums(t.dk, key_row),
                                 sums(t.dv, key_row),    t.dq.stride(0),
                                 t.dk.stride(0),         t.log_sums.data_ptr<float>() + head * problem.rows + row,
                                 scratch.delta,          part.task->queries,
                                 problem.keys(sequence), problem.channels,
                                 problem.scale};
        dot_rows(HeadRows<float>(t.dy, head, row), HeadRows<float>(t.out, head, row), part.task->queries,
                 problem.channels, scratch.delta);
        products::RowsAhead ahead = rows_of_next(problem, now, next, t);
        backward_of(now, scratch, ahead);
      });
}

}  // namespace anigen::nn
