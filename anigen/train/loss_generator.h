#pragma once
#include <string_view>

#include "anigen/nn/generator.h"
#include "anigen/train/stage.h"

namespace anigen::train {

/// Random numbers of one micro-batch: nn::numbered_generator() by (seed, step, micro_batch) and a purpose, so that a
/// loss does not depend on replicas, threads or what was drawn before.
at::Generator loss_generator(const LossContext& context, std::string_view purpose);

}  // namespace anigen::train
