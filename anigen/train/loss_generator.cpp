#include "anigen/train/loss_generator.h"

#include <ATen/CPUGeneratorImpl.h>

#include "anigen/core/random.h"

namespace anigen::train {
namespace {

constexpr std::uint64_t kMostMicroBatches = 1 << 20;

}  // namespace

at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index) {
  return at::detail::createCPUGenerator(Rng(seed, purpose, index).next());
}

at::Generator loss_generator(const LossContext& context, std::string_view purpose) {
  const std::uint64_t index = static_cast<std::uint64_t>(context.step) * kMostMicroBatches + context.micro_batch;
  return numbered_generator(context.seed, purpose, index);
}

}  // namespace anigen::train
