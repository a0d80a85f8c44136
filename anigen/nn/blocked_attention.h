#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// softmax(q kᵀ / √D) v, a block of queries at a time, so that scores of N x M are never held whole, forward or
/// backward; the backward pass forms them again from the saved log-sum-exp of each row. Softmax in fp32. Can be
/// differentiated once; a second time is an error. On a CPU the same number of threads gives the same bits, and another
/// number may round sums otherwise. On a CPU 16-bit inputs are multiplied in fp32; with AVX512-BF16 the forward pass
/// multiplies bf16 as it is, adds up in fp32 and rounds the weights of the softmax to bf16. A row with scores that are
/// not finite becomes NaN. On a GPU the fused attention of LibTorch 2 is used.
/// @param q [B, H, N, D] @param k, v [B, H, M, D], dtype of q @return [B, H, N, D], dtype of q
Tensor blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v);

/// Most bytes a thread of the CPU version allocates beside tensors of the sizes of q, k, v and the result (in fp32), in
/// the forward or the backward pass: two blocks of scores, at most 0.5 MiB, or one and a block of the result.
/// @param queries, keys N and M @param head_channels D
std::int64_t blocked_attention_scratch_bytes(std::int64_t queries, std::int64_t keys, std::int64_t head_channels);

}  // namespace anigen::nn
