#pragma once
#include "anigen/nn/ragged_tasks.h"

namespace anigen::nn {

/// The forward pass of cpu_ragged_attention() by the kernels for bf16, where prefers_bf16_attention() says so.
/// Holds a copy of k and v of sequences with more than 192 queries or 1,024 keys beside the arguments. The bits do not
/// depend on the number of threads.
/// @param q, k, v bf16, channels adjacent @param out [N, H, D] bf16, dense; rows of queries without keys are left alone
/// @param log_sums [H, N] fp32
void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums);

}  // namespace anigen::nn
