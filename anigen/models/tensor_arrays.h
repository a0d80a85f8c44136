#pragma once
#include "anigen/io/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// A tensor on the CPU that holds a copy of the array. Unsigned 16- and 32-bit integers, which torch lacks, become
/// int32 and int64. @throws InputError for uint64 and for bytes that do not fill the shape
Tensor to_tensor(const io::NdArray& array);

/// A copy of the tensor's values, contiguous, from any device. @throws Error for dtypes files do not hold (complex,
/// quantised)
io::NdArray to_array(const Tensor& tensor);

/// torch's name of an array dtype. @throws InputError for the dtypes torch lacks
torch::Dtype torch_dtype(io::Dtype dtype);
io::Dtype array_dtype(torch::Dtype dtype);

}  // namespace anigen::models
