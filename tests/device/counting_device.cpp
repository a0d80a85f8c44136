#include "tests/device/counting_device.h"

#include <ATen/core/dispatch/Dispatcher.h>
#include <c10/core/impl/DeviceGuardImplInterface.h>
#include <torch/library.h>

#include <array>
#include <iterator>
#include <mutex>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

namespace anigen::test {

namespace {

using c10::IValue;
using torch::Tensor;
using Stack = torch::jit::Stack;

constexpr torch::DeviceType kKind = torch::kXPU;

std::mutex requests_mutex;
DeviceRequests requests;

void count_wait(const std::string& name) {
  const std::lock_guard<std::mutex> lock(requests_mutex);
  ++requests.waits[name];
}

void count_upload(bool non_blocking) {
  if (!non_blocking) count_wait("copy of pageable memory");
  const std::lock_guard<std::mutex> lock(requests_mutex);
  ++requests.uploads;
}

// --- Memory: an address of the device is that of the host with a bit that no address of a process has ---

constexpr std::uintptr_t kFar = std::uintptr_t{1} << 62;

void* far_address(void* near) {
  return near == nullptr ? near : reinterpret_cast<void*>(reinterpret_cast<std::uintptr_t>(near) | kFar);
}
void* near_address(void* far) { return reinterpret_cast<void*>(reinterpret_cast<std::uintptr_t>(far) & ~kFar); }

bool is_ours(const Tensor& tensor) { return tensor.defined() && tensor.device().type() == kKind; }

// A tensor over the memory of another one, which it keeps alive.
Tensor over_memory_of(const Tensor& tensor, void* address, torch::Device device, c10::DispatchKey key) {
  const auto release = [](void* kept) { delete static_cast<c10::Storage*>(kept); };
  c10::DataPtr data(address, new c10::Storage(tensor.storage()), release, device);
  c10::Storage storage(c10::Storage::use_byte_size_t(), tensor.storage().nbytes(), std::move(data),
                       c10::GetAllocator(torch::kCPU), /*resizable=*/true);
  Tensor made = at::detail::make_tensor<c10::TensorImpl>(std::move(storage), c10::DispatchKeySet(key), tensor.dtype());
  made.unsafeGetTensorImpl()->set_sizes_and_strides(tensor.sizes(), tensor.strides(), tensor.storage_offset());
  return made;
}

Tensor on_host(const Tensor& ours) {
  return over_memory_of(ours, near_address(ours.storage().data_ptr().get()), torch::kCPU, c10::DispatchKey::CPU);
}

Tensor on_device(const Tensor& host) {
  return over_memory_of(host, far_address(host.storage().data_ptr().get()), torch::Device(kKind, 0),
                        c10::DispatchKey::XPU);
}

// --- Operators ---

// Those whose result a GPU cannot give, or not give the size of, before it has computed it.
const std::set<std::string>& reading_operators() {
  static const std::set<std::string> names{"aten::_local_scalar_dense",
                                           "aten::nonzero",
                                           "aten::masked_select",
                                           "aten::_unique",
                                           "aten::_unique2",
                                           "aten::unique_dim",
                                           "aten::unique_consecutive",
                                           "aten::unique_dim_consecutive",
                                           "aten::equal",
                                           "aten::bincount",
                                           "aten::multinomial",
                                           "aten::histc"};
  return names;
}

void count_operator(const c10::OperatorHandle& op, const std::vector<IValue>& given) {
  const std::string& name = op.schema().name();
  {
    const std::lock_guard<std::mutex> lock(requests_mutex);
    ++requests.operators;
  }
  if (reading_operators().count(name) > 0) return count_wait(name);
  if (name == "aten::repeat_interleave" && given.back().isNone()) return count_wait(name);
}

// A GPU's operators take from the host numbers alone, and lists of places.
void refuse_host_tensor(const c10::OperatorHandle& op, const Tensor& tensor) {
  const std::string& name = op.schema().name();
  if (!tensor.defined() || is_ours(tensor) || tensor.dim() == 0) return;
  if (name == "aten::index" || name.rfind("aten::index_put", 0) == 0 || name == "aten::_index_put_impl_")
    return count_upload(/*non_blocking=*/false);
  TORCH_CHECK(false, name, " of tensors of a device and of the host");
}

// An argument as the CPU's operator takes it. @param found our tensors and what stands for them
IValue for_host(const c10::OperatorHandle& op, const IValue& value, std::vector<std::pair<Tensor, Tensor>>& found) {
  const auto taken = [&](const Tensor& tensor) {
    refuse_host_tensor(op, tensor);
    if (!is_ours(tensor)) return tensor;
    found.emplace_back(tensor, on_host(tensor));
    return found.back().second;
  };
  if (value.isTensor()) return taken(value.toTensor());
  if (value.isTensorList()) {
    c10::List<Tensor> list;
    for (const Tensor& tensor : value.toTensorVector()) list.push_back(taken(tensor));
    return list;
  }
  if (value.isOptionalTensorList()) {
    c10::List<c10::optional<Tensor>> list;
    for (const c10::optional<Tensor>& tensor : value.toOptionalTensorVector())
      list.push_back(tensor ? c10::optional<Tensor>(taken(*tensor)) : c10::nullopt);
    return list;
  }
  if (value.isDevice() && value.toDevice().type() == kKind) return torch::Device(torch::kCPU);
  return value;
}

// Memory and shape of an argument that the operator has resized.
void take_changes(const Tensor& ours, const Tensor& host) {
  if (host.sizes() == ours.sizes() && host.strides() == ours.strides() &&
      host.storage().data_ptr().get() == near_address(ours.storage().data_ptr().get()))
    return;
  const Tensor changed = on_device(host);
  c10::TensorImpl* const impl = ours.unsafeGetTensorImpl();
  impl->set_storage_keep_dtype(changed.storage());
  impl->set_sizes_and_strides(changed.sizes(), changed.strides(), changed.storage_offset());
}

IValue for_device(const IValue& value, const std::vector<std::pair<Tensor, Tensor>>& found) {
  const auto given = [&](const Tensor& tensor) {
    if (!tensor.defined()) return tensor;
    for (const auto& [ours, host] : found) {
      if (host.is_same(tensor)) return ours;
    }
    return on_device(tensor);
  };
  if (value.isTensor()) return given(value.toTensor());
  if (value.isTensorList()) {
    c10::List<Tensor> list;
    for (const Tensor& tensor : value.toTensorVector()) list.push_back(given(tensor));
    return list;
  }
  return value;
}

void compute(const c10::OperatorHandle& op, Stack* stack) {
  const auto count = static_cast<std::ptrdiff_t>(op.schema().arguments().size());
  std::vector<IValue> given(std::make_move_iterator(stack->end() - count), std::make_move_iterator(stack->end()));
  stack->erase(stack->end() - count, stack->end());
  count_operator(op, given);
  std::vector<std::pair<Tensor, Tensor>> found;
  for (const IValue& value : given) stack->push_back(for_host(op, value, found));
  op.redispatchBoxed(c10::DispatchKeySet(c10::DispatchKey::CPU), stack);
  for (const auto& [ours, host] : found) take_changes(ours, host);
  const auto results = static_cast<std::ptrdiff_t>(op.schema().returns().size());
  for (auto value = stack->end() - results; value != stack->end(); ++value) *value = for_device(*value, found);
}

Tensor near_one(const Tensor& tensor) { return is_ours(tensor) ? on_host(tensor) : tensor; }

// Convolutions, which LibTorch asks a device of an own kind for by these names.
Tensor convolution(const Tensor& input, const Tensor& weight, const c10::optional<Tensor>& bias,
                   torch::IntArrayRef stride, torch::IntArrayRef padding, torch::IntArrayRef dilation, bool transposed,
                   torch::IntArrayRef output_padding, std::int64_t groups) {
  const c10::optional<Tensor> shift = bias && bias->defined() ? c10::optional<Tensor>(near_one(*bias)) : c10::nullopt;
  return on_device(at::convolution(near_one(input), near_one(weight), shift, stride, padding, dilation, transposed,
                                   output_padding, groups));
}

std::tuple<Tensor, Tensor, Tensor> convolution_backward(const Tensor& slopes, const Tensor& input, const Tensor& weight,
                                                        torch::IntArrayRef stride, torch::IntArrayRef padding,
                                                        torch::IntArrayRef dilation, bool transposed,
                                                        torch::IntArrayRef output_padding, std::int64_t groups,
                                                        std::array<bool, 3> wanted) {
  const std::int64_t channels = slopes.size(1);
  const auto [to_input, to_weight, to_bias] =
      at::convolution_backward(near_one(slopes), near_one(input), near_one(weight), torch::IntArrayRef(channels),
                               stride, padding, dilation, transposed, output_padding, groups, wanted);
  const auto back = [](const Tensor& tensor) { return tensor.defined() ? on_device(tensor) : tensor; };
  return {back(to_input), back(to_weight), back(to_bias)};
}

Tensor& copy_to(Tensor& to, const Tensor& from, bool non_blocking) {
  if (!is_ours(to)) count_wait("copy to the host");
  if (!is_ours(from) && from.numel() > 0) count_upload(non_blocking);
  near_one(to).copy_(near_one(from));
  return to;
}

struct Registration {
  Registration()
      : guard(kKind, new c10::impl::NoOpDeviceGuardImpl<kKind>()),
        library(torch::Library::IMPL, "aten", c10::DispatchKey::XPU, __FILE__, __LINE__),
        fallback(torch::Library::IMPL, "_", c10::DispatchKey::XPU, __FILE__, __LINE__) {
    library.impl("copy_", TORCH_FN(copy_to));
    library.impl("convolution_overrideable", TORCH_FN(convolution));
    library.impl("convolution_backward_overrideable", TORCH_FN(convolution_backward));
    fallback.fallback(torch::CppFunction::makeFromBoxedFunction<&compute>());
  }
  c10::impl::DeviceGuardImplRegistrar guard;
  torch::Library library, fallback;
};

}  // namespace

torch::Device counting_device() {
  static const auto* const kept = new Registration();  // LibTorch's own tables may go first
  static_cast<void>(kept);
  return {kKind, 0};
}

std::int64_t DeviceRequests::all_waits() const {
  std::int64_t sum = 0;
  for (const auto& [name, count] : waits) sum += count;
  return sum;
}

DeviceRequests device_requests() {
  const std::lock_guard<std::mutex> lock(requests_mutex);
  return requests;
}

void forget_requests() {
  const std::lock_guard<std::mutex> lock(requests_mutex);
  requests = {};
}

std::string waits_text(const DeviceRequests& requests) {
  std::string text =
      std::to_string(requests.all_waits()) + " waits of " + std::to_string(requests.operators) + " operators";
  for (const auto& [name, count] : requests.waits) text += "; " + name + " " + std::to_string(count);
  return text;
}

}  // namespace anigen::test
