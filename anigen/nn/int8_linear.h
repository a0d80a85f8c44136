#pragma once
#include "anigen/nn/kernels/int8_products.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// x wᵀ + b with weights of 8-bit integers and rows rounded to such as they are multiplied
/// (nn/kernels/int8_products.h), summed in fp32. For sampling: records no gradient. @param x [..., in] fp32 or bf16 in
/// CPU memory @param bias [out] or undefined @return [..., out] of the dtype of x
Tensor int8_linear(const Tensor& x, const kernels::Int8Matrix& weight, const Tensor& bias);

/// Rounds the weights of all linear layers below a module whose widths are both at least kFewestInt8Width to 8-bit
/// integers, for good: their parameter `weight` is left without numbers, a quarter of the memory remains, and the model
/// can neither learn nor be saved. @return how many layers it rounded
/// @throws NotSupportedError on a GPU; InputError for a weight with a number that is not finite
std::int64_t quantize_linears(torch::nn::Module& module);

inline constexpr std::int64_t kFewestInt8Width = 64;  ///< narrower ones are little work, and padded to whole groups

}  // namespace anigen::nn
