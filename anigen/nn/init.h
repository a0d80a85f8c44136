#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// LibTorch's random numbers for anything that is numbered, such as a held-out asset or a sample: a CPU generator
/// seeded by (seed, purpose, index). LibTorch's generator begins with 32 bits of its seed: of many indices some share
/// their random numbers, by chance and far apart.
at::Generator numbered_generator(std::uint64_t seed, std::string_view purpose, std::uint64_t index);

/// Initial values that a model's constructor leaves.
enum class Init {
  kPublished,  ///< the published initial values, drawn from torch's default generator (seed it with torch::manual_seed)
  kNone        ///< nothing: memory is reserved but not written; load every tensor (strictly) before use
};

/// Xavier-uniform weights and zero biases for every Linear below `module` (docs/reference/autoencoders.md, 1.6). Of a
/// low-rank addition `lora_A` becomes zero and `lora_B` 0.01 · N(0, 1) (docs/reference/flows.md, 1.5).
void xavier_uniform_linears(torch::nn::Module& module);

/// Kaiming-uniform weights with gain 1 and the fan-in, |w| <= sqrt(3 / in), and zero biases for every Linear below
/// `module` (docs/reference/autoencoders.md, 1.6).
void kaiming_uniform_linears(torch::nn::Module& module);

/// PyTorch's default for every Conv3d below `module`: weights and biases uniform in ± 1 / sqrt(fan-in) (the
/// Kaiming-uniform rule with a = sqrt(5)).
void default_convolutions(torch::nn::Module& module);

/// Ones and zeros for the weight and the bias of every AffineLayerNorm and VolumeNorm below `module`, ones for the
/// gamma of every MultiHeadRmsNorm.
void default_norms(torch::nn::Module& module);

/// Weight ~ N(0, std²), zero bias: the layers of a timestep embedder (docs/reference/flows.md, 1.6).
void normal_linear(LinearImpl& linear, double std = 0.02);

/// Zeros in every parameter of this module and those below.
void zero_parameters(torch::nn::Module& module);

/// Base of convolutions that are defined above nn (sparse::SubmanifoldKernel): fp16 conversion concerns them too.
class Convolution {
 public:
  virtual ~Convolution() = default;
};

/// True for linears and convolutions, dense and sparse: the published fp16 conversion changes their own parameters.
bool is_linear_or_convolution(const torch::nn::Module& module);

/// Converts the parameters of every Linear and convolution below `module`, in place; norms and bare parameters keep
/// their type (docs/reference/autoencoders.md, 1.4).
void cast_linears(torch::nn::Module& module, torch::Dtype dtype);

/// "[2, 8, 4]", for messages.
std::string shape_text(torch::IntArrayRef shape);
/// Of a tensor; "nothing" for an undefined one.
std::string shape_text(const Tensor& tensor);

/// @throws InputError naming the tensor unless it is [rows, columns]; -1 for any number of rows
inline void require_matrix(const torch::Tensor& tensor, std::int64_t rows, std::int64_t columns,
                           const std::string& name) {
  if (tensor.defined() && tensor.dim() == 2 && tensor.size(1) == columns && (rows < 0 || tensor.size(0) == rows))
    return;
  const std::string wanted = rows < 0 ? "N" : std::to_string(rows);
  throw InputError("", name,
                   "expected shape [" + wanted + ", " + std::to_string(columns) + "], got " + shape_text(tensor));
}

/// A tensor [N, 3] of any device and floating-point type as points on the CPU.
/// @throws InputError naming the tensor on another shape
template <typename Scalar = float>
std::vector<Eigen::Matrix<Scalar, 3, 1>> points_of(const torch::Tensor& tensor, const std::string& name) {
  require_matrix(tensor, -1, 3, name);
  const torch::Tensor values = tensor.detach().to(torch::kCPU, c10::CppTypeToScalarType<Scalar>::value).contiguous();
  const Scalar* numbers = values.data_ptr<Scalar>();
  std::vector<Eigen::Matrix<Scalar, 3, 1>> points(static_cast<std::size_t>(values.size(0)));
  for (Eigen::Matrix<Scalar, 3, 1>& point : points) {
    point = Eigen::Matrix<Scalar, 3, 1>(numbers[0], numbers[1], numbers[2]);
    numbers += 3;
  }
  return points;
}

/// A tensor on the CPU that holds a copy of the array. Unsigned 16- and 32-bit integers, which torch lacks, become
/// int32 and int64. @throws InputError for uint64 and for bytes that do not fill the shape
Tensor to_tensor(const io::NdArray& array);

/// A copy of the tensor's values, contiguous, from any device. @throws Error for dtypes files do not hold (complex,
/// quantised)
io::NdArray to_array(const Tensor& tensor);

/// torch's name of an array dtype. @throws InputError for the dtypes torch lacks
torch::Dtype torch_dtype(io::Dtype dtype);

}  // namespace anigen::nn
