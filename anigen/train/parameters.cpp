#include "anigen/train/parameters.h"

#include <algorithm>
#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"

namespace anigen::train {

namespace {

template <typename Visit>
void for_each_parameter(const std::vector<nn::NamedModel>& models, bool trainable, const Visit& visit) {
  for (const nn::NamedModel& model : models) {
    for (const auto& entry : model.module->named_parameters()) {
      if (entry.value().requires_grad() == trainable) visit(model.name + "." + entry.key(), entry.value());
    }
  }
}

ANIGEN_EXACT_KERNEL(void, ema_pass,
                    (float* __restrict average, const float* __restrict master, std::int64_t n, float keep, float take),
                    (average, master, n, keep, take)) {
  for (std::int64_t i = 0; i < n; ++i) average[i] = average[i] * keep + master[i] * take;
}

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

ParameterBuffer::ParameterBuffer(const std::vector<nn::NamedModel>& models, const std::function<void()>& convert) {
  std::int64_t count = 0;
  torch::Device device(torch::kCPU);
  bool wide = true;
  for_each_parameter(models, /*trainable=*/true, [&](const std::string&, const torch::Tensor& parameter) {
    count += parameter.numel();
    device = parameter.device();
    wide = wide && parameter.scalar_type() == torch::kFloat64;
  });
  if (count == 0) throw Error("no trainable parameter: every model is frozen");
  const auto options = torch::TensorOptions().dtype(wide ? torch::kFloat64 : torch::kFloat32).device(device);
  master_ = torch::empty({count}, options);
  std::int64_t offset = 0;
  torch::NoGradGuard no_grad;
  for_each_parameter(models, /*trainable=*/true, [&](const std::string&, const torch::Tensor& parameter) {
    master_.narrow(0, offset, parameter.numel()).copy_(parameter.reshape({-1}));
    offset += parameter.numel();
  });
  // Converting gives a parameter other storage; what detach() returns stays with the one it has now.
  for_each_parameter(models, /*trainable=*/false, [&](const std::string& name, const torch::Tensor& parameter) {
    frozen_[name] = parameter.detach();
  });
  if (convert) convert();
  attach(models);
}

ParameterBuffer ParameterBuffer::share(const std::vector<nn::NamedModel>& models) const {
  ParameterBuffer twin;
  twin.master_ = master_;
  twin.attach(models);
  bool same = twin.slots_.size() == slots_.size();
  for (std::size_t i = 0; same && i < slots_.size(); ++i)
    same = twin.slots_[i].name == slots_[i].name && twin.slots_[i].offset == slots_[i].offset;
  if (!same) throw Error("replicas of a model have different parameters");
  return twin;
}

void ParameterBuffer::attach(const std::vector<nn::NamedModel>& models) {
  gradient_ = torch::zeros_like(master_);
  std::int64_t offset = 0;
  for_each_parameter(models, /*trainable=*/true, [&](const std::string& name, torch::Tensor parameter) {
    if (offset + parameter.numel() > master_.numel()) throw Error("replicas of a model have different parameters");
    const Slot slot{name, parameter, offset, parameter.scalar_type() == master_.scalar_type()};
    offset += parameter.numel();
    if (slot.view) {
      parameter.set_data(part(master_, slot));
      parameter.mutable_grad() = part(gradient_, slot);
    }
    slots_.push_back(slot);
  });
  publish();
}

torch::Tensor ParameterBuffer::part(const torch::Tensor& flat, const Slot& slot) const {
  return flat.narrow(0, slot.offset, slot.parameter.numel()).view(slot.parameter.sizes());
}

torch::Tensor ParameterBuffer::frozen(const std::string& name) const {
  const auto found = frozen_.find(name);
  return found == frozen_.end() ? torch::Tensor() : found->second;
}

void ParameterBuffer::zero_gradients() {
  gradient_.zero_();
  for (Slot& slot : slots_) {
    if (!slot.view) slot.parameter.mutable_grad() = torch::Tensor();
  }
}

void ParameterBuffer::collect_gradients() {
  for (const Slot& slot : slots_) collect_gradient(slot);
}

void ParameterBuffer::collect_gradient(const Slot& slot) const {
  torch::NoGradGuard no_grad;
  const torch::Tensor& grad = slot.parameter.grad();
  if (slot.view) {
    if (!grad.defined() || grad.data_ptr() != part(gradient_, slot).data_ptr())
      throw Error("gradient of " + slot.name + " was replaced during the backward pass");
  } else if (grad.defined()) {
    part(gradient_, slot).copy_(grad);
  }
}

void ParameterBuffer::publish() {
  torch::NoGradGuard no_grad;
  for (Slot& slot : slots_) {
    if (!slot.view) slot.parameter.copy_(part(master_, slot));
  }
}

std::string ParameterBuffer::first_not_finite(const torch::Tensor& flat) const {
  for (const Slot& slot : slots_) {
    if (!torch::isfinite(part(flat, slot)).all().item<bool>()) return slot.name;
  }
  return "";
}

Ema::Ema(const std::vector<double>& rates, const torch::Tensor& master) : rates_(rates) {
  for (const double rate : rates) {
    if (!(rate >= 0.0 && rate < 1.0)) throw InputError("", "ema_rate", "every rate must lie in [0, 1)");
    averages_.push_back(master.detach().clone());
  }
}

void Ema::update(const torch::Tensor& master, double most) {
  torch::NoGradGuard no_grad;
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    torch::Tensor& average = averages_[i];
    const double rate = std::min(rates_[i], most);
    if (average.is_cpu() && average.scalar_type() == torch::kFloat32) {
      ema_pass(average.data_ptr<float>(), master.data_ptr<float>(), average.numel(), static_cast<float>(rate),
               static_cast<float>(1.0 - rate));
    } else {
      average.mul_(rate).add_(master, 1.0 - rate);
    }
  }
}

io::NamedArrays weights_of(const nn::NamedModel& model, const ParameterBuffer& buffer, const torch::Tensor& flat) {
  torch::NoGradGuard no_grad;
  const auto slots = slots_of(model, buffer);
  io::NamedArrays arrays;
  for (const nn::StateEntry& entry : nn::state_entries(*model.module)) {
    const auto slot = slots.find(entry.key);
    torch::Tensor value =
        slot == slots.end() ? buffer.frozen(model.name + "." + entry.key) : buffer.part(flat, *slot->second);
    if (!value.defined()) value = entry.tensor;  // a buffer of the model
    arrays.emplace_back(entry.key, nn::to_array(value));
  }
  return arrays;
}

void set_weights(const nn::NamedModel& model, const ParameterBuffer& buffer, torch::Tensor flat,
                 const io::NamedArrays& arrays, const std::string& source) {
  torch::NoGradGuard no_grad;
  const auto slots = slots_of(model, buffer);
  const std::vector<nn::StateEntry> entries = nn::state_entries(*model.module);
  if (entries.size() != arrays.size()) {
    throw InputError(
        source, "",
        "holds " + std::to_string(arrays.size()) + " tensors, the model has " + std::to_string(entries.size()));
  }
  for (const nn::StateEntry& entry : entries) {
    const io::NdArray* array = io::find(arrays, entry.key);
    if (array == nullptr) throw InputError(source, entry.key, "no such tensor");
    const torch::Tensor value = nn::to_tensor(*array);
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
