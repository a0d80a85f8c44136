#include "anigen/models/freezing.h"

namespace anigen::models {
namespace {

constexpr char kTrainableMark[] = "lora";

void freeze_parameter(const std::string& path, torch::Tensor parameter) {
  if (path.find(kTrainableMark) == std::string::npos) parameter.set_requires_grad(false);
}

}  // namespace

void freeze_modules(torch::nn::Module& module, const std::vector<std::string>& names) {
  const auto children = module.named_children();
  const auto own = module.named_parameters(/*recurse=*/false);
  for (const std::string& name : names) {
    if (const auto* parameter = own.find(name)) freeze_parameter(name, *parameter);
    const auto* child = children.find(name);
    if (child == nullptr) continue;
    for (const auto& item : (*child)->named_parameters()) freeze_parameter(item.key(), item.value());
  }
}

std::vector<std::string> frozen_parameters(const torch::nn::Module& module) {
  std::vector<std::string> keys;
  for (const auto& item : module.named_parameters()) {
    if (!item.value().requires_grad()) keys.push_back(item.key());
  }
  return keys;
}

}  // namespace anigen::models
