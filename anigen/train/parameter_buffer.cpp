#include "anigen/train/parameter_buffer.h"

#include "anigen/core/error.h"

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

template <typename Visit>
void for_each_trainable(const std::vector<nn::NamedModel>& models, const Visit& visit) {
  for_each_parameter(models, /*trainable=*/true, visit);
}

}  // namespace

ParameterBuffer::ParameterBuffer(const std::vector<nn::NamedModel>& models, const std::function<void()>& convert) {
  std::int64_t count = 0;
  torch::Device device(torch::kCPU);
  bool wide = true;
  for_each_trainable(models, [&](const std::string&, const torch::Tensor& parameter) {
    count += parameter.numel();
    device = parameter.device();
    wide = wide && parameter.scalar_type() == torch::kFloat64;
  });
  if (count == 0) throw Error("no trainable parameter: every model is frozen");
  const auto options = torch::TensorOptions().dtype(wide ? torch::kFloat64 : torch::kFloat32).device(device);
  master_ = torch::empty({count}, options);
  std::int64_t offset = 0;
  torch::NoGradGuard no_grad;
  for_each_trainable(models, [&](const std::string&, const torch::Tensor& parameter) {
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
  for (std::size_t i = 0; same && i < slots_.size(); ++i) {
    same = twin.slots_[i].name == slots_[i].name && twin.slots_[i].offset == slots_[i].offset;
  }
  if (!same) throw Error("replicas of a model have different parameters");
  return twin;
}

void ParameterBuffer::attach(const std::vector<nn::NamedModel>& models) {
  gradient_ = torch::zeros_like(master_);
  std::int64_t offset = 0;
  for_each_trainable(models, [&](const std::string& name, torch::Tensor parameter) {
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
    if (!grad.defined() || grad.data_ptr() != part(gradient_, slot).data_ptr()) {
      throw Error("gradient of " + slot.name + " was replaced during the backward pass");
    }
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

}  // namespace anigen::train
