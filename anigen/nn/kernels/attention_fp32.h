#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// blocked_attention on a CPU for fp32, bf16 and fp16: blocks of queries against blocks of keys, with a running
/// softmax, so that scores and weights stay in the cache (after Dao et al. 2022, "FlashAttention"). Sums are fp32.
/// Threads share out blocks of queries forward, and heads backward; nn/attention.h says when the result does not
/// depend on their number.
Tensor cpu_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v);

/// ragged_attention on a CPU for fp32, bf16 and fp16. Threads take (sequence, heads, block of queries) forward and
/// (sequence, heads) backward, the largest first; keys pass in blocks with a running softmax (after Dao et al. 2022,
/// "FlashAttention"), and the backward pass forms scores again from the saved log-sum-exp of each query. Rows of a head
/// are copied to scratch memory of the thread, which holds a block of scores (two backward), the rows it is made of
/// and, backward, the gradient of all queries of one head of a sequence. The forward pass of bf16 has its own kernels
/// on CPUs with AVX512-BF16 (attention_bf16.h). Arguments as ragged_attention, which checks them.
Tensor cpu_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                            const Tensor& k_offsets);

}  // namespace anigen::nn
