#pragma once
#include <memory>
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// A model under the name it has in the config; checkpoints are called after it.
struct NamedModel {
  std::string name;
  std::shared_ptr<torch::nn::Module> module;
};

}  // namespace anigen::nn
