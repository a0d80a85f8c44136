#include "anigen/train/model_weights.h"

#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::train {
namespace {

// Slots of one model by state-dict key.
std::unordered_map<std::string, const ParameterBuffer::Slot*> slots_of(const nn::NamedModel& model,
                                                                       const ParameterBuffer& buffer) {
  std::unordered_map<std::string, const ParameterBuffer::Slot*> slots;
  const std::string prefix = model.name + ".";
  for (const ParameterBuffer::Slot& slot : buffer.slots()) {
    if (slot.name.rfind(prefix, 0) == 0) slots[slot.name.substr(prefix.size())] = &slot;
  }
  return slots;
}

}  // namespace

io::NamedArrays weights_of(const nn::NamedModel& model, const ParameterBuffer& buffer, const torch::Tensor& flat) {
  torch::NoGradGuard no_grad;
  const auto slots = slots_of(model, buffer);
  io::NamedArrays arrays;
  for (const models::StateEntry& entry : models::state_entries(*model.module)) {
    const auto slot = slots.find(entry.key);
    torch::Tensor value =
        slot == slots.end() ? buffer.frozen(model.name + "." + entry.key) : buffer.part(flat, *slot->second);
    if (!value.defined()) value = entry.tensor;  // a buffer of the model
    arrays.emplace_back(entry.key, models::to_array(value));
  }
  return arrays;
}

void set_weights(const nn::NamedModel& model, const ParameterBuffer& buffer, torch::Tensor flat,
                 const io::NamedArrays& arrays, const std::string& source) {
  torch::NoGradGuard no_grad;
  const auto slots = slots_of(model, buffer);
  const std::vector<models::StateEntry> entries = models::state_entries(*model.module);
  if (entries.size() != arrays.size()) {
    throw InputError(
        source, "",
        "holds " + std::to_string(arrays.size()) + " tensors, the model has " + std::to_string(entries.size()));
  }
  for (const models::StateEntry& entry : entries) {
    const io::NdArray* array = io::find(arrays, entry.key);
    if (array == nullptr) throw InputError(source, entry.key, "no such tensor");
    const torch::Tensor value = models::to_tensor(*array);
    if (value.sizes() != entry.tensor.sizes()) throw InputError(source, entry.key, "has another shape than the model");
    const auto slot = slots.find(entry.key);
    if (slot != slots.end()) {
      buffer.part(flat, *slot->second).copy_(value);
    } else {
      torch::Tensor original = buffer.frozen(model.name + "." + entry.key);
      if (original.defined()) original.copy_(value);
      torch::Tensor(entry.tensor).copy_(value);
    }
  }
}

}  // namespace anigen::train
