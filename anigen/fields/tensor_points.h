#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/nn/torch.h"

namespace anigen::fields {

/// @throws InputError naming the tensor unless it is [rows, columns]; -1 for any number of rows
inline void require_matrix(const torch::Tensor& tensor, std::int64_t rows, std::int64_t columns,
                           const std::string& name) {
  if (tensor.defined() && tensor.dim() == 2 && tensor.size(1) == columns && (rows < 0 || tensor.size(0) == rows)) {
    return;
  }
  const std::string wanted = rows < 0 ? "N" : std::to_string(rows);
  throw InputError("", name,
                   "expected shape [" + wanted + ", " + std::to_string(columns) + "], got " + nn::shape_text(tensor));
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

}  // namespace anigen::fields
