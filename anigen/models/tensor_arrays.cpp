#include "anigen/models/tensor_arrays.h"

#include <cstring>
#include <string>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

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

torch::Dtype torch_dtype(io::Dtype dtype) {
  switch (dtype) {
    case io::Dtype::kBool:
      return torch::kBool;
    case io::Dtype::kU8:
      return torch::kUInt8;
    case io::Dtype::kI8:
      return torch::kInt8;
    case io::Dtype::kI16:
      return torch::kInt16;
    case io::Dtype::kI32:
      return torch::kInt32;
    case io::Dtype::kI64:
      return torch::kInt64;
    case io::Dtype::kF16:
      return torch::kHalf;
    case io::Dtype::kBF16:
      return torch::kBFloat16;
    case io::Dtype::kF32:
      return torch::kFloat32;
    case io::Dtype::kF64:
      return torch::kFloat64;
    default:
      throw InputError("", "", std::string("an array of ") + io::name_of(dtype) + " cannot become a tensor");
  }
}

io::Dtype array_dtype(torch::Dtype dtype) {
  switch (dtype) {
    case torch::kBool:
      return io::Dtype::kBool;
    case torch::kUInt8:
      return io::Dtype::kU8;
    case torch::kInt8:
      return io::Dtype::kI8;
    case torch::kInt16:
      return io::Dtype::kI16;
    case torch::kInt32:
      return io::Dtype::kI32;
    case torch::kInt64:
      return io::Dtype::kI64;
    case torch::kHalf:
      return io::Dtype::kF16;
    case torch::kBFloat16:
      return io::Dtype::kBF16;
    case torch::kFloat32:
      return io::Dtype::kF32;
    case torch::kFloat64:
      return io::Dtype::kF64;
    default:
      throw Error(std::string("a tensor of ") + torch::toString(dtype) + " cannot be written to a file");
  }
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

}  // namespace anigen::models
