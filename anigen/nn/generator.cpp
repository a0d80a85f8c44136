#include "anigen/nn/generator.h"

#include <ATen/CPUGeneratorImpl.h>

#include "anigen/core/random.h"

namespace anigen::nn {

at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index) {
  return at::detail::createCPUGenerator(Rng(seed, purpose, index).next());
}

}  // namespace anigen::nn
