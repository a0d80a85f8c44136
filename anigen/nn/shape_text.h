#pragma once
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// "[2, 8, 4]", for messages.
std::string shape_text(torch::IntArrayRef shape);
/// Of a tensor; "nothing" for an undefined one.
std::string shape_text(const Tensor& tensor);

}  // namespace anigen::nn
