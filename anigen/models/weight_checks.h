#pragma once
#include <string>

#include "anigen/io/ndarray.h"

namespace anigen::models {

/// fp16, bf16, fp32 or fp64.
bool is_floating_point(io::Dtype dtype);

/// For weights that come from elsewhere. @param file for messages
/// @throws InputError naming the key of an array that is not floating-point, or that holds a value that is not finite
void check_weight_values(const io::NamedArrays& arrays, const std::string& file);

}  // namespace anigen::models
