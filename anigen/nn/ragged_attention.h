#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

using torch::Tensor;

/// softmax(q kᵀ / √D) v within each of S sequences of different length: rows offsets[s] … offsets[s+1] of q see rows
/// k_offsets[s] … k_offsets[s+1] of k and v. A query without keys gives exactly 0, and passes no gradient. No padding;
/// scores of a sequence are never held whole when it is long (see nn/blocked_attention.h). On a CPU sums and softmax of
/// fp32 and 16-bit values are fp32, each sequence and head is computed by one thread at a time, and the result, forward
/// and backward, is the same for any number of threads; there it can be differentiated once, a second time is an error.
/// A query with scores that are not finite becomes NaN. On a GPU, and in fp64, sequences of similar length are padded
/// and computed together by tensor operations.
/// @param q [N, H, D] @param k, v [M, H, D], dtype of q @param q_offsets, k_offsets [S + 1] int64, CPU, ascending from
/// 0 to N and M @return [N, H, D], dtype of q
Tensor ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                        const Tensor& k_offsets);

}  // namespace anigen::nn
