#pragma once
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/torch.h"

namespace anigen::nn::kernels {

/// State of the softmax of some rows whose scores arrive in blocks of columns (Milakov and Gimelshein 2018, "Online
/// normalizer calculation for softmax"), one value per row.
struct RunningSoftmax {
  float* largest;  ///< largest score so far; -inf before the first block
  float* sum;      ///< Σ exp(scale (score − largest)); 0 before the first block
  float* shrink;   ///< what earlier sums have to be multiplied with after this block
};

/// One block: on return each score holds exp(scale (score − largest)) and the state includes it. A row with a score
/// that is not finite gets the sum NaN. @param scores [rows, columns] dense
void softmax_block(float* scores, std::int64_t rows, std::int64_t columns, float scale, const RunningSoftmax& state);

/// values[r, :] *= factors[r] @param values [rows, columns] dense
void scale_rows(float* values, std::int64_t rows, std::int64_t columns, const float* factors);

/// The end of the running softmax: out[r, :] = values[r, :] / sum[r], and log_sums[r] = scale · largest[r] + ln sum[r],
/// the log-sum-exp of the scaled scores. @param values [rows, columns] dense @param out rows `stride` values apart
void softmax_finish(const float* values, std::int64_t rows, std::int64_t columns, float scale,
                    const RunningSoftmax& state, float* out, std::int64_t stride, float* log_sums);

/// The backward pass of one block, in place: scores → weights p = exp(scale score − log_sums[r]); slopes dL/dp →
/// dL/dscore = scale p (dL/dp − delta[r]), where delta[r] = Σ p dL/dp over the whole row. Both [rows, columns] dense.
void softmax_backward_block(float* scores, float* slopes, std::int64_t rows, std::int64_t columns, float scale,
                            const float* log_sums, const float* delta);

}  // namespace anigen::nn::kernels

namespace anigen::nn {

/// blocked_attention on a CPU for fp32, bf16 and fp16: blocks of queries against blocks of keys, with a running
/// softmax, so that scores and weights stay in the cache (after Dao et al. 2022, "FlashAttention"). Sums are fp32.
/// Threads share out blocks of queries forward, and heads backward; nn/attention.h says when the result does not
/// depend on their number.
Tensor cpu_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v);

/// kernels::softmax_block for short rows with gaps between them: on return each score holds exp(scale (score −
/// largest)), those far below the largest at least e^-87, and the state includes it; from `columns` to
/// products::padded(columns) the rows may hold anything. A row with a score that is not finite, or below -1e38, gets
/// the sum NaN.
void softmax_rows(const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
                  const kernels::RunningSoftmax& state);

using torch::Tensor;

/// ragged_attention on a CPU for fp32, bf16 and fp16. Threads take (sequence, heads, block of queries) forward and
/// (sequence, heads) backward, the largest first; keys pass in blocks with a running softmax (after Dao et al. 2022,
/// "FlashAttention"), and the backward pass forms scores again from the saved log-sum-exp of each query. Rows of a head
/// are copied to scratch memory of the thread, which holds a block of scores (two backward), the rows it is made of
/// and, backward, the gradient of all queries of one head of a sequence. The forward pass of bf16 has its own kernels
/// on CPUs with AVX512-BF16 (attention_bf16.h). Arguments as ragged_attention, which checks them.
Tensor cpu_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                            const Tensor& k_offsets);

}  // namespace anigen::nn
