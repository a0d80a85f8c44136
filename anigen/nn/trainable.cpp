#include "anigen/nn/trainable.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/nn/init.h"
#include "anigen/nn/int8_linear.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

namespace {

constexpr char kTrainableMark[] = "lora";
constexpr std::size_t kMostLeftBehind = std::size_t{1} << 28;  // bytes of weights that were converted

void freeze_parameter(const std::string& path, torch::Tensor parameter) {
  if (path.find(kTrainableMark) == std::string::npos) parameter.set_requires_grad(false);
}

using RecomputedPart = std::function<Tensor(const std::vector<Tensor>&)>;

// A function as a value that an AutogradContext can keep.
struct KeptPart : torch::CustomClassHolder {
  explicit KeptPart(RecomputedPart kept) : part(std::move(kept)) {}
  RecomputedPart part;
};

struct RecomputedCall {
  RecomputedPart part;
  Tensor output;  // when it is known already; detached
};

class Recompute : public torch::autograd::Function<Recompute> {
 public:
  // `anchor` requires a gradient, so that the backward pass runs for the parameters also when no input needs one.
  static Tensor forward(AutogradContext* context, const Tensor& anchor, const RecomputedCall& call,
                        const at::TensorList& inputs) {
    static_cast<void>(anchor);
    context->saved_data["part"] = c10::IValue::make_capsule(c10::make_intrusive<KeptPart>(call.part));
    context->save_for_backward(inputs.vec());
    if (call.output.defined()) return call.output;
    return call.part(inputs.vec());  // autograd switches recording off around forward()
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto kept = c10::static_intrusive_pointer_cast<KeptPart>(context->saved_data["part"].toCapsule());
    std::vector<Tensor> inputs;
    for (const Tensor& saved : context->get_saved_variables()) {
      Tensor input = saved.detach();
      input.set_requires_grad(saved.requires_grad());
      inputs.push_back(input);
    }
    Tensor output;
    {
      const torch::AutoGradMode with_grad(true);
      output = kept->part(inputs);
    }
    if (output.requires_grad()) torch::autograd::backward({output}, {gradients[0]});
    variable_list result = {Tensor(), Tensor()};
    for (const Tensor& input : inputs) result.push_back(input.requires_grad() ? input.grad() : Tensor());
    return result;
  }
};

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

FreezableModel::FreezableModel(Parts parts) : parts_(std::move(parts)) {}

void FreezableModel::apply_freezing() {
  std::vector<std::string> names = parts_.to_freeze;
  if (parts_.all_is_a_word && std::find(names.begin(), names.end(), "all") != names.end()) {
    for (const auto& item : named_parameters(/*recurse=*/false)) names.push_back(item.key());
    for (const auto& item : named_children()) names.push_back(item.key());
  }
  freeze_modules(*this, names);
}

std::vector<std::string> FreezableModel::half_precision_modules() const {
  std::vector<std::string> names = parts_.always_fp16;
  if (!parts_.use_fp16) return names;
  for (const auto* more : {&parts_.torso, &parts_.torso_parameters, &parts_.other_fp16})
    names.insert(names.end(), more->begin(), more->end());
  return names;
}

void FreezableModel::convert_to_fp16() {
  if (!parameters().front().is_cuda()) throw NotSupportedError("", "", "fp16 on a CPU; move the model to a GPU first");
  cast(half_precision_modules(), torch::kHalf);
}

void FreezableModel::set_torso_dtype(torch::Dtype dtype) {
  cast(parts_.torso, dtype);
  auto parameters = named_parameters(/*recurse=*/false);
  for (const std::string& name : parts_.torso_parameters) {
    Tensor& parameter = parameters[name];
    parameter.set_data(parameter.data().to(dtype));
  }
}

void FreezableModel::cast(const std::vector<std::string>& names, torch::Dtype dtype) {
  const auto modules = named_modules();
  for (const std::string& name : names) cast_linears(*modules[name], dtype);
}

void FlowModel::set_compute_dtype(torch::Dtype dtype) {
  const auto convert = conversion(dtype);
  for (const auto& item : named_parameters()) convert(item.key());
  release_freed_memory();  // of the weights as they were
}

std::function<void(const std::string& key)> FlowModel::conversion(torch::Dtype dtype) {
  const bool int8 = dtype == torch::kInt8, cuda = torso_weight_.is_cuda();
  if (dtype == torch::kHalf && !cuda)
    throw NotSupportedError("", "", "fp16 on a CPU; use bf16, or move the model to a GPU first");
  if (int8 && cuda) throw NotSupportedError("", "", "8-bit weights on a GPU; use bf16 or fp16");
  const torch::Dtype rest = !int8 ? dtype : kernels::has_bf16_products() ? torch::kBFloat16 : torch::kFloat32;

  struct Change {
    Tensor parameter;
    LinearImpl* rounded = nullptr;  // the layer whose weight it is, when that gets eight bits
  };
  auto changes = std::make_shared<std::unordered_map<std::string, Change>>();
  const auto modules = named_modules();
  for (const std::string& name : parts_.torso) {
    for (const auto& part : modules[name]->named_modules(name)) {
      if (!is_linear_or_convolution(*part.value())) continue;
      for (const auto& item : part.value()->named_parameters(/*recurse=*/false))
        (*changes)[part.key() + "." + item.key()].parameter = item.value();
      auto* const linear = part.value()->as<LinearImpl>();
      if (int8 && linear != nullptr && quantizes(*linear)) (*changes)[part.key() + ".weight"].rounded = linear;
    }
  }
  const auto own = named_parameters(/*recurse=*/false);
  for (const std::string& name : parts_.torso_parameters) (*changes)[name].parameter = own[name];

  return [changes, rest, left = std::size_t{0}](const std::string& key) mutable {
    const auto found = changes->find(key);
    if (found == changes->end()) return;
    Tensor& parameter = found->second.parameter;
    left += parameter.nbytes();
    if (found->second.rounded != nullptr) quantize(*found->second.rounded, key);
    parameter.set_data(parameter.data().to(rest));
    // Freed memory stays with programs (keep_freed_memory()), and what one weight left seldom fits the next ones.
    if (left < kMostLeftBehind) return;
    release_freed_memory();
    left = 0;
  };
}

void FlowModel::check_conditions(const Tensor& t, const Tensor& cond, std::int64_t batch, std::int64_t channels) {
  if (t.dim() != 1 || t.size(0) != batch) throw InputError("", "t", "expected one time per item");
  if (cond.dim() != 3 || cond.size(2) != channels || (cond.size(0) != batch && cond.size(0) != 1)) {
    throw InputError("", "cond",
                     "expected tokens [" + std::to_string(batch) + " or 1, M, " + std::to_string(channels) +
                         "], found " + shape_text(cond));
  }
}

Latent deterministic_latent(const Tensor& z) { return {z, z.detach(), torch::zeros_like(z)}; }

Latent sampled_latent(const Tensor& raw, std::int64_t axis, const Tensor& noise) {
  const std::vector<Tensor> halves = raw.chunk(2, axis);
  const Tensor &mean = halves[0], &logvar = halves[1];
  if (!noise.defined()) return {mean, mean, logvar};
  if (noise.sizes() != mean.sizes())
    throw InputError("", "noise", shape_text(noise) + " does not fit latents " + shape_text(mean));
  return {mean + torch::exp(0.5 * logvar) * noise.to(mean.options()), mean, logvar};
}

Tensor recomputed(const std::vector<Tensor>& inputs, const RecomputedPart& part, bool on) {
  if (!on || !at::GradMode::is_enabled()) return part(inputs);
  RecomputedCall call{part, {}};
  const auto wants_gradient = [](const Tensor& input) { return input.requires_grad(); };
  if (std::none_of(inputs.begin(), inputs.end(), wants_gradient)) {
    // Only the part knows its parameters: whether one of them wants a gradient shows in what it returns. If none does,
    // nothing was kept; else what was kept goes with this output.
    const Tensor output = part(inputs);
    if (!output.requires_grad()) return output;
    call.output = output.detach();
  }
  const Tensor anchor = torch::zeros({1}, torch::requires_grad());
  return Recompute::apply(anchor, call, at::TensorList(inputs));
}

}  // namespace anigen::nn
