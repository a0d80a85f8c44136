#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// blocked_attention by LibTorch's operations alone, for any device and dtype: `rows` queries of every head at a time.
Tensor tensor_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t rows);

}  // namespace anigen::nn
