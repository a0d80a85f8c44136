#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Whether cpu_bf16_attention() takes these queries on this CPU: bf16, heads of 16 to 64 channels, AVX512-BF16.
bool prefers_bf16_attention(const Tensor& q);

/// The forward pass of blocked_attention() by kernels for bf16 (bf16_attention_kernels.h). The bits do not depend on
/// the number of threads. Holds a copy of k and v beside the arguments.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], channels adjacent @param log_sums [B · H, N] fp32, filled
/// @return [B, N, H, D] bf16
Tensor cpu_bf16_attention(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums);

}  // namespace anigen::nn
