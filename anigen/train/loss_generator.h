#pragma once
#include <string_view>

#include "anigen/nn/torch.h"
#include "anigen/train/stage.h"

namespace anigen::train {

/// LibTorch's random numbers for one micro-batch: a CPU generator seeded by (seed, step, micro_batch) and a purpose, so
/// that a loss does not depend on replicas, threads or what was drawn before. LibTorch's generator begins with 32 bits
/// of its seed: in a long run some micro-batches share their random numbers, by chance and far apart.
at::Generator loss_generator(const LossContext& context, std::string_view purpose);

/// The same for anything else that is numbered: a held-out asset, a sample.
at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index);

}  // namespace anigen::train
