#include "anigen/models/state_dict.h"

#include <algorithm>
#include <set>
#include <type_traits>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/nn/init.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

void collect(const torch::nn::Module& module, const std::string& prefix, std::vector<StateEntry>& entries) {
  for (const auto& item : module.named_parameters(/*recurse=*/false)) {
    if (item.value().defined()) entries.push_back({prefix + item.key(), item.value(), false});
  }
  for (const auto& item : module.named_buffers(/*recurse=*/false)) {
    if (item.value().defined()) entries.push_back({prefix + item.key(), item.value(), true});
  }
  for (const auto& child : module.named_children()) collect(*child.value(), prefix + child.key() + ".", entries);
}

std::string some_of(const std::vector<std::string>& keys) {
  constexpr std::size_t kShown = 4;
  std::string text;
  for (std::size_t i = 0; i < keys.size() && i < kShown; ++i) text += (i > 0 ? ", " : "") + keys[i];
  if (keys.size() > kShown) text += " and " + std::to_string(keys.size() - kShown) + " more";
  return text;
}

void check_strict(const LoadReport& report, const std::string& source) {
  std::string problem;
  if (!report.missing.empty()) problem = "missing " + some_of(report.missing);
  if (!report.unexpected.empty())
    problem += (problem.empty() ? "" : "; ") + ("unexpected " + some_of(report.unexpected));
  if (!problem.empty()) throw InputError(source, "", "these are not the weights of this model: " + problem);
}

bool lies_below(const std::string& key, const std::string& module) {
  return key.size() > module.size() && key.compare(0, module.size(), module) == 0 && key[module.size()] == '.';
}

}  // namespace

std::vector<StateEntry> state_entries(const torch::nn::Module& module) {
  std::vector<StateEntry> entries;
  collect(module, "", entries);
  return entries;
}

io::NamedArrays state_dict(const torch::nn::Module& module) {
  io::NamedArrays arrays;
  for (const StateEntry& entry : state_entries(module)) arrays.emplace_back(entry.key, to_array(entry.tensor));
  return arrays;
}

namespace {

/// @param done called with each array when it is in the model
template <typename Arrays, typename Done>
LoadReport load_arrays(torch::nn::Module& module, Arrays& arrays, LoadMode mode, const std::string& source,
                       const Done& done) {
  using Array = std::remove_reference_t<decltype((arrays.begin()->second))>;
  std::unordered_map<std::string, Array*> by_key;
  for (auto& [key, array] : arrays) by_key[key] = &array;

  LoadReport report;
  std::unordered_set<std::string> used;
  std::vector<std::pair<Tensor, Array*>> copies;
  for (const StateEntry& entry : state_entries(module)) {
    const auto found = by_key.find(entry.key);
    if (found == by_key.end()) {
      report.missing.push_back(entry.key);
      continue;
    }
    used.insert(entry.key);
    if (entry.tensor.sizes() != torch::IntArrayRef(found->second->shape)) {
      throw InputError(source, entry.key,
                       "the file has shape " + nn::shape_text(found->second->shape) + ", the model " +
                           nn::shape_text(entry.tensor.sizes()));
    }
    torch_dtype(found->second->dtype);  // refuses what a tensor cannot hold before anything is written
    copies.emplace_back(entry.tensor, found->second);
  }
  for (const auto& [key, array] : arrays) {
    if (used.count(key) == 0) report.unexpected.push_back(key);
  }
  if (mode == LoadMode::kStrict) check_strict(report, source);

  const torch::NoGradGuard no_grad;
  for (auto& [tensor, array] : copies) {
    tensor.copy_(to_tensor(*array));
    done(*array);
  }
  return report;
}

}  // namespace

LoadReport load_state_dict(torch::nn::Module& module, const io::NamedArrays& arrays, LoadMode mode,
                           const std::string& source) {
  return load_arrays(module, arrays, mode, source, [](const io::NdArray&) {});
}

LoadReport load_state_dict(torch::nn::Module& module, io::NamedArrays&& arrays, LoadMode mode,
                           const std::string& source) {
  return load_arrays(module, arrays, mode, source,
                     [](io::NdArray& array) { std::vector<std::uint8_t>().swap(array.bytes); });
}

std::vector<torch::Dtype> published_dtypes(const torch::nn::Module& module,
                                           const std::vector<std::string>& half_precision_modules) {
  std::set<std::string> half(half_precision_modules.begin(), half_precision_modules.end());
  for (const auto& part : module.named_modules()) {
    const bool below = std::any_of(half_precision_modules.begin(), half_precision_modules.end(),
                                   [&](const std::string& name) { return lies_below(part.key() + ".", name); });
    if (!below || !nn::is_linear_or_convolution(*part.value())) continue;
    for (const auto& item : part.value()->named_parameters(/*recurse=*/false))
      half.insert(part.key() + "." + item.key());
  }
  std::vector<torch::Dtype> dtypes;
  for (const StateEntry& entry : state_entries(module)) {
    const torch::Dtype own = entry.tensor.scalar_type();
    dtypes.push_back(half.count(entry.key) > 0 ? torch::kHalf : torch::isFloatingType(own) ? torch::kFloat32 : own);
  }
  return dtypes;
}

}  // namespace anigen::models
