#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// The values of a bf16 tensor as their 16 bits, as the kernels for bf16 take them.
inline std::uint16_t* bf16_bits(const Tensor& x) {
  return reinterpret_cast<std::uint16_t*>(x.data_ptr<at::BFloat16>());
}

}  // namespace anigen::nn
