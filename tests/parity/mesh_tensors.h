#pragma once

#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "tests/parity/eigen_tensors.h"

namespace anigen::test {

/// A tensor [N,3] as points in single precision.
inline std::vector<Eigen::Vector3f> float_points(const torch::Tensor& tensor) {
  std::vector<Eigen::Vector3f> list;
  for (const Eigen::Vector3d& point : points(tensor)) list.emplace_back(point.cast<float>());
  return list;
}

/// A tensor [F,3] as triangles.
inline std::vector<Triangle> triangles(const torch::Tensor& tensor) {
  const std::vector<int> flat = ints(tensor);
  std::vector<Triangle> list;
  for (std::size_t i = 0; i + 2 < flat.size(); i += 3) list.push_back({flat[i], flat[i + 1], flat[i + 2]});
  return list;
}

/// Dense weights [V,J] as rows; unlike from_dense() this leaves a row without weights empty.
inline SkinWeights skin_rows(const torch::Tensor& tensor) {
  const Eigen::MatrixXd dense = matrix(tensor);
  SkinWeights skin;
  for (Eigen::Index v = 0; v < dense.rows(); ++v) {
    std::vector<Influence> row;
    for (Eigen::Index j = 0; j < dense.cols(); ++j) {
      row.push_back({static_cast<std::int32_t>(j), static_cast<float>(dense(v, j))});
    }
    skin.append_row(std::move(row));
  }
  return skin;
}

}  // namespace anigen::test
