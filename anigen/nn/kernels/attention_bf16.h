#pragma once
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// True when cpu_bf16_attention() takes these queries on this CPU: bf16, heads of 16 to 64 channels, AVX512-BF16.
bool prefers_bf16_attention(const Tensor& q);

/// The forward pass of blocked_attention() by kernels for bf16. The bits do not depend on
/// the number of threads. Holds a copy of k and v beside the arguments.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], channels adjacent @param log_sums [B · H, N] fp32, filled
/// @return [B, N, H, D] bf16
Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums);

/// The forward pass of cpu_ragged_attention() by the kernels for bf16, where prefers_bf16_attention() says so.
/// Holds a copy of k and v of sequences with more than 192 queries or 1,024 keys beside the arguments. The bits do not
/// depend on the number of threads.
/// @param q, k, v bf16, channels adjacent @param out [N, H, D] bf16, dense; rows of queries without keys are left alone
/// @param log_sums [H, N] fp32
void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums);

}  // namespace anigen::nn
