#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

using torch::Tensor;

/// ragged_attention by tensor operations, for a GPU and for fp64: sequences are sorted by length, and as many of about
/// the same length as bounded memory for their scores allows are padded and computed together; one that is too long for
/// that goes through blocked_attention. Arguments as ragged_attention, which checks them.
Tensor tensor_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                               const Tensor& k_offsets);

}  // namespace anigen::nn
