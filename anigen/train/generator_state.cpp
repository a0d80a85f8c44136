#include "anigen/train/generator_state.h"

#include <ATen/CPUGeneratorImpl.h>

#include <cstring>

#include "anigen/nn/torch.h"

namespace anigen::train {

std::string generator_state() {
  const torch::Tensor state = at::detail::getDefaultCPUGenerator().get_state();
  return {static_cast<const char*>(state.data_ptr()), static_cast<std::size_t>(state.nbytes())};
}

void set_generator_state(const std::string& bytes) {
  const torch::Tensor state = torch::empty({static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
  std::memcpy(state.data_ptr(), bytes.data(), bytes.size());
  at::Generator generator = at::detail::getDefaultCPUGenerator();
  generator.set_state(state);
}

}  // namespace anigen::train
