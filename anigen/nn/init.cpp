#include "anigen/nn/init.h"

#include <ATen/CPUGeneratorImpl.h>
#include <cmath>
#include <cstring>
#include <utility>

#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/volumes.h"

namespace anigen::nn {

at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index) {
  return at::detail::createCPUGenerator(Rng(seed, purpose, index).next());
}

namespace {

template <typename LinearType>
void xavier_uniform(LinearType& linear) {
  torch::nn::init::xavier_uniform_(linear.weight);
  if (linear.bias.defined()) torch::nn::init::zeros_(linear.bias);
}

void initial_lora(LinearImpl& linear) {
  if (!linear.lora_A.defined()) return;
  torch::nn::init::zeros_(linear.lora_A);
  torch::nn::init::normal_(linear.lora_B, 0.0, 0.01);
}

template <typename NormType>
void ones_and_zeros(NormType& norm) {
  torch::nn::init::ones_(norm.weight);
  torch::nn::init::zeros_(norm.bias);
}

constexpr std::pair<io::Dtype, torch::Dtype> kDtypes[] = {
    {io::Dtype::kBool, torch::kBool},  {io::Dtype::kU8, torch::kUInt8},      {io::Dtype::kI8, torch::kInt8},
    {io::Dtype::kI16, torch::kInt16},  {io::Dtype::kI32, torch::kInt32},     {io::Dtype::kI64, torch::kInt64},
    {io::Dtype::kF16, torch::kHalf},   {io::Dtype::kBF16, torch::kBFloat16}, {io::Dtype::kF32, torch::kFloat32},
    {io::Dtype::kF64, torch::kFloat64}};

io::Dtype array_dtype(torch::Dtype dtype) {
  for (const auto& [array, tensor] : kDtypes) {
    if (tensor == dtype) return array;
  }
  throw Error(std::string("a tensor of ") + torch::toString(dtype) + " cannot be written to a file");
}

void check_size(const io::NdArray& array) {
  if (array.bytes.size() == array.count() * io::size_of(array.dtype)) return;
  throw InputError("", "",
                   "an array of " + std::to_string(array.count()) + " values holds " +
                       std::to_string(array.bytes.size()) + " bytes");
}

template <typename Wide, typename Narrow>
Tensor widened(const io::NdArray& array, torch::Dtype dtype) {
  Tensor tensor = torch::empty(array.shape, torch::TensorOptions().dtype(dtype));
  Wide* out = tensor.data_ptr<Wide>();
  for (std::size_t i = 0; i < array.count(); ++i) {
    Narrow value;
    std::memcpy(&value, array.bytes.data() + i * sizeof(Narrow), sizeof(Narrow));
    out[i] = static_cast<Wide>(value);
  }
  return tensor;
}

}  // namespace

void xavier_uniform_linears(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* linear = part.as<LinearImpl>()) {
      xavier_uniform(*linear);
      initial_lora(*linear);
    }
    if (auto* linear = part.as<torch::nn::LinearImpl>()) xavier_uniform(*linear);
  });
}

void kaiming_uniform_linears(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* linear = part.as<LinearImpl>();
    if (linear == nullptr) return;
    torch::nn::init::kaiming_uniform_(linear->weight, 0.0, torch::kFanIn, torch::kLinear);
    if (linear->bias.defined()) torch::nn::init::zeros_(linear->bias);
    initial_lora(*linear);
  });
}

void default_convolutions(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* convolution = part.as<Conv3dImpl>();
    if (convolution == nullptr) return;
    const Tensor& weight = convolution->weight;
    const double bound = 1.0 / std::sqrt(static_cast<double>(weight.numel() / weight.size(0)));
    torch::nn::init::uniform_(weight, -bound, bound);
    torch::nn::init::uniform_(convolution->bias, -bound, bound);
  });
}

void default_norms(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* norm = part.as<AffineLayerNormImpl>()) ones_and_zeros(*norm);
    if (auto* norm = part.as<VolumeNormImpl>()) ones_and_zeros(*norm);
    if (auto* norm = part.as<MultiHeadRmsNormImpl>()) torch::nn::init::ones_(norm->gamma);
  });
}

void normal_linear(LinearImpl& linear, double std) {
  torch::nn::init::normal_(linear.weight, 0.0, std);
  if (linear.bias.defined()) torch::nn::init::zeros_(linear.bias);
}

void zero_parameters(torch::nn::Module& module) {
  for (const Tensor& parameter : module.parameters()) torch::nn::init::zeros_(parameter);
}

bool is_linear_or_convolution(const torch::nn::Module& module) {
  return module.as<LinearImpl>() != nullptr || module.as<torch::nn::LinearImpl>() != nullptr ||
         module.as<Conv3dImpl>() != nullptr || module.as<torch::nn::Conv1dImpl>() != nullptr ||
         module.as<torch::nn::Conv2dImpl>() != nullptr || module.as<torch::nn::Conv3dImpl>() != nullptr ||
         dynamic_cast<const Convolution*>(&module) != nullptr;
}

void cast_linears(torch::nn::Module& module, torch::Dtype dtype) {
  module.apply([dtype](torch::nn::Module& part) {
    if (!is_linear_or_convolution(part)) return;
    for (Tensor& parameter : part.parameters(/*recurse=*/false)) parameter.set_data(parameter.data().to(dtype));
  });
}

std::string shape_text(torch::IntArrayRef shape) { return "[" + joined(shape) + "]"; }

std::string shape_text(const Tensor& tensor) { return tensor.defined() ? shape_text(tensor.sizes()) : "nothing"; }

torch::Dtype torch_dtype(io::Dtype dtype) {
  for (const auto& [array, tensor] : kDtypes) {
    if (array == dtype) return tensor;
  }
  throw InputError("", "", std::string("an array of ") + io::name_of(dtype) + " cannot become a tensor");
}

Tensor to_tensor(const io::NdArray& array) {
  check_size(array);
  if (array.dtype == io::Dtype::kU16) return widened<std::int32_t, std::uint16_t>(array, torch::kInt32);
  if (array.dtype == io::Dtype::kU32) return widened<std::int64_t, std::uint32_t>(array, torch::kInt64);
  Tensor tensor = torch::empty(array.shape, torch::TensorOptions().dtype(torch_dtype(array.dtype)));
  if (!array.bytes.empty()) std::memcpy(tensor.data_ptr(), array.bytes.data(), array.bytes.size());
  return tensor;
}

io::NdArray to_array(const Tensor& tensor) {
  io::NdArray array;
  array.dtype = array_dtype(tensor.scalar_type());
  const Tensor values = tensor.detach().to(torch::kCPU).contiguous();
  array.shape.assign(values.sizes().begin(), values.sizes().end());
  array.bytes.resize(static_cast<std::size_t>(values.nbytes()));
  if (!array.bytes.empty()) std::memcpy(array.bytes.data(), values.data_ptr(), array.bytes.size());
  return array;
}

}  // namespace anigen::nn
