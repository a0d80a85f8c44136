#pragma once
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// @param what the argument that is wrong @throws InputError unless the condition holds
void require(bool condition, const std::string& what, const std::string& problem);

/// @param shape the sizes wanted, -1 for any @throws InputError naming the tensor and both shapes
void require_shape(const Tensor& tensor, const std::vector<std::int64_t>& shape, const std::string& what);

}  // namespace anigen::models::anymate
