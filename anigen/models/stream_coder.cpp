#include "anigen/models/stream_coder.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/models/freezing.h"
#include "anigen/nn/init.h"

namespace anigen::models {

StreamCoder::StreamCoder(Parts parts) : parts_(std::move(parts)) {}

void StreamCoder::apply_freezing() {
  std::vector<std::string> names = parts_.to_freeze;
  if (parts_.all_is_a_word && std::find(names.begin(), names.end(), "all") != names.end()) {
    for (const auto& item : named_parameters(/*recurse=*/false)) names.push_back(item.key());
    for (const auto& item : named_children()) names.push_back(item.key());
  }
  freeze_modules(*this, names);
}

std::vector<std::string> StreamCoder::half_precision_modules() const {
  std::vector<std::string> names = parts_.always;
  if (parts_.use_fp16) {
    names.insert(names.end(), parts_.torso.begin(), parts_.torso.end());
    names.insert(names.end(), parts_.beside.begin(), parts_.beside.end());
  }
  return names;
}

void StreamCoder::convert_to_fp16() {
  if (!parameters().front().is_cuda()) {
    throw NotSupportedError("", "", "fp16 on a CPU; move the model to a GPU first");
  }
  cast(half_precision_modules(), torch::kHalf);
}

void StreamCoder::set_torso_dtype(torch::Dtype dtype) { cast(parts_.torso, dtype); }

void StreamCoder::cast(const std::vector<std::string>& names, torch::Dtype dtype) {
  const auto modules = named_modules();
  for (const std::string& name : names) nn::cast_linears(*modules[name], dtype);
}

}  // namespace anigen::models
