#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// blocked_attention on a CPU for fp32, bf16 and fp16: blocks of queries against blocks of keys, with a running
/// softmax, so that scores and weights stay in the cache (after Dao et al. 2022, "FlashAttention"). Sums are fp32.
/// Threads share out blocks of queries forward, and heads backward; blocked_attention.h says when the result does not
/// depend on their number.
Tensor cpu_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v);

}  // namespace anigen::nn
