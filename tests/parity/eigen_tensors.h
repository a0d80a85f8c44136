#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::test {

/// A tensor [R,C] (or [R], read as one column) of any floating-point or integer type, as doubles.
inline Eigen::MatrixXd matrix(const torch::Tensor& tensor) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  TORCH_CHECK(tensor.dim() == 1 || tensor.dim() == 2, "expected one or two dimensions");
  const torch::Tensor values = tensor.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const RowMajor>(values.data_ptr<double>(), values.size(0), values.dim() == 2 ? values.size(1) : 1);
}

/// A tensor [N,3] as points.
inline std::vector<Eigen::Vector3d> points(const torch::Tensor& tensor) {
  TORCH_CHECK(tensor.dim() == 2 && tensor.size(1) == 3, "expected shape [N,3]");
  const Eigen::MatrixXd rows = matrix(tensor);
  std::vector<Eigen::Vector3d> list;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) list.emplace_back(rows.row(i).transpose());
  return list;
}

/// A tensor of any shape as integers in row-major order.
inline std::vector<int> ints(const torch::Tensor& tensor) {
  const torch::Tensor values = tensor.detach().to(torch::kCPU, torch::kInt32).contiguous();
  return {values.data_ptr<int>(), values.data_ptr<int>() + values.numel()};
}

/// A matrix as a float64 tensor [R,C] that owns its memory.
inline torch::Tensor tensor(const Eigen::MatrixXd& matrix) {
  const torch::Tensor result = torch::empty({matrix.rows(), matrix.cols()}, torch::kFloat64);
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) result.data_ptr<double>()[i * matrix.cols() + j] = matrix(i, j);
  }
  return result;
}

inline torch::Tensor scalar(double value) { return torch::full({}, value, torch::kFloat64); }

}  // namespace anigen::test
