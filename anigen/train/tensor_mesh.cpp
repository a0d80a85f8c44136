#include "anigen/train/tensor_mesh.h"

#include <vector>

#include "anigen/fields/tensor_points.h"

namespace anigen::train {

using torch::Tensor;

Mesh mesh_of(const Tensor& vertices, const Tensor& faces) {
  Mesh mesh;
  mesh.vertices = fields::points_of<float>(vertices, "vertices");
  const Tensor corners = faces.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* corner = corners.data_ptr<std::int64_t>();
  mesh.faces.resize(static_cast<std::size_t>(corners.size(0)));
  for (Triangle& face : mesh.faces) {
    for (std::int32_t& index : face) index = static_cast<std::int32_t>(*corner++);
  }
  return mesh;
}

std::vector<Eigen::Vector3d> joint_positions(const Tensor& joints) {
  return fields::points_of<double>(joints, "joints");
}

std::vector<int> joint_parents(const Tensor& parents) {
  const Tensor rows = parents.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* first = rows.data_ptr<std::int64_t>();
  std::vector<int> list;
  for (std::int64_t i = 0; i < rows.size(0); ++i) list.push_back(static_cast<int>(first[i]));
  return list;
}

SkinWeights skin_of(const Tensor& dense) {
  const Tensor rows = dense.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const float* first = rows.data_ptr<float>();
  return from_dense(std::vector<float>(first, first + rows.numel()), static_cast<std::size_t>(rows.size(0)),
                    static_cast<std::size_t>(rows.size(1)));
}

}  // namespace anigen::train
