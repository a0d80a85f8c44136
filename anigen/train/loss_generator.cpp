#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

constexpr std::uint64_t kMostMicroBatches = 1 << 20;

}  // namespace

at::Generator loss_generator(const LossContext& context, std::string_view purpose) {
  const std::uint64_t index = static_cast<std::uint64_t>(context.step) * kMostMicroBatches + context.micro_batch;
  return nn::numbered_generator(context.seed, purpose, index);
}

}  // namespace anigen::train
