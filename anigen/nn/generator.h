#pragma once
#include <cstdint>
#include <string_view>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// LibTorch's random numbers for anything that is numbered, such as a held-out asset or a sample: a CPU generator
/// seeded by (seed, purpose, index). LibTorch's generator begins with 32 bits of its seed: of many indices some share
/// their random numbers, by chance and far apart.
at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index);

}  // namespace anigen::nn
