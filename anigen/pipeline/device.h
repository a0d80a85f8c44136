#pragma once
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::pipeline {

/// "cpu", "cuda" or "cuda:N". @throws InputError that says what this build and machine have
torch::Device parse_device(const std::string& name);

}  // namespace anigen::pipeline
