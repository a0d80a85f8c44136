#pragma once
#include <string>

#include "anigen/nn/kernels/int8_products.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// x wᵀ + b with weights of 8-bit integers and rows rounded to such as they are multiplied
/// (nn/kernels/int8_products.h), summed in fp32. For sampling: records no gradient. @param x [..., in] fp32 or bf16 in
/// CPU memory @param bias [out] or undefined @return [..., out] of the dtype of x
Tensor int8_linear(const Tensor& x, const kernels::Int8Matrix& weight, const Tensor& bias);

/// True for a layer that gets 8-bit weights: both widths at least kFewestInt8Width, and not rounded yet.
bool quantizes(const LinearImpl& linear);

/// Rounds the weight of a layer to 8-bit integers, for good: the parameter `weight` is left without numbers, a quarter
/// of the memory remains, and the layer can neither learn nor be saved. @param linear in CPU memory @param key of the
/// weight, for messages @throws InputError for a weight with a number that is not finite
void quantize(LinearImpl& linear, const std::string& key);

inline constexpr std::int64_t kFewestInt8Width = 64;  ///< narrower ones are little work, and padded to whole groups

}  // namespace anigen::nn
