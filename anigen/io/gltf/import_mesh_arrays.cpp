#include "anigen/io/gltf/import_mesh_arrays.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::io::gltf_import {

Placement::Placement(const Eigen::Matrix4d& matrix) : matrix_(matrix) {
  const Eigen::Matrix3d m = matrix.topLeftCorner<3, 3>();
  is_mirroring_ = m.determinant() < 0.0;
  // Cofactors: the inverse transpose up to a factor, which also exist for collapsed meshes.
  normal_matrix_.col(0) = m.col(1).cross(m.col(2));
  normal_matrix_.col(1) = m.col(2).cross(m.col(0));
  normal_matrix_.col(2) = m.col(0).cross(m.col(1));
  if (is_mirroring_) normal_matrix_ = Eigen::Matrix3d(-normal_matrix_);
}

Eigen::Vector3f Placement::position(const VertexBlock& block, std::size_t vertex) const {
  const Eigen::Vector3f p = Eigen::Map<const Eigen::Vector3f>(block.positions.data() + 3 * vertex);
  return (matrix_.topLeftCorner<3, 3>() * p.cast<double>() + matrix_.topRightCorner<3, 1>()).cast<float>();
}

Eigen::Vector3f Placement::normal(const VertexBlock& block, std::size_t vertex) const {
  if (block.normals.empty()) return Eigen::Vector3f::Zero();
  const Eigen::Vector3f n = Eigen::Map<const Eigen::Vector3f>(block.normals.data() + 3 * vertex);
  const Eigen::Vector3d turned = normal_matrix_ * n.cast<double>();
  const double length = turned.norm();
  if (!(length > 1e-150) || !std::isfinite(length)) return Eigen::Vector3f::Zero();
  return (turned / length).cast<float>().normalized();
}

void MeshArrays::add_vertex(const VertexBlock& block, std::size_t vertex, const Placement& placement) {
  any_normals_ = any_normals_ || !block.normals.empty();
  any_uvs_ = any_uvs_ || !block.uvs.empty();
  any_colors_ = any_colors_ || !block.colors.empty();
  mesh_.vertices.push_back(placement.position(block, vertex));
  if (!mesh_.vertices.back().allFinite())
    throw InputError(file_, "/meshes", "a vertex leaves the range of float in the bind pose");
  mesh_.normals.push_back(placement.normal(block, vertex));
  Eigen::Vector2f uv = Eigen::Vector2f::Zero();
  if (!block.uvs.empty()) uv = Eigen::Map<const Eigen::Vector2f>(block.uvs.data() + 2 * vertex);
  mesh_.uvs.push_back(uv);
  Eigen::Vector4f color = Eigen::Vector4f::Ones();
  if (!block.colors.empty()) color = Eigen::Map<const Eigen::Vector4f>(block.colors.data() + 4 * vertex);
  mesh_.colors.push_back(color);
}

void MeshArrays::add_faces(const std::vector<Triangle>& faces, std::size_t first_vertex, bool turn_around,
                           int material) {
  const auto base = static_cast<std::int32_t>(first_vertex);
  for (const Triangle& face : faces) {
    Triangle moved = {face[0] + base, face[1] + base, face[2] + base};
    if (turn_around) std::swap(moved[1], moved[2]);
    mesh_.faces.push_back(moved);
    mesh_.face_materials.push_back(material);
  }
}

Mesh MeshArrays::finish(Notes& notes) {
  if (mesh_.faces.empty()) throw InputError(file_, "/meshes", "the scene has no triangles");
  if (!any_normals_) mesh_.normals.clear();
  if (!any_uvs_) mesh_.uvs.clear();
  if (!any_colors_) mesh_.colors.clear();
  const bool has_materials =
      std::any_of(mesh_.face_materials.begin(), mesh_.face_materials.end(), [](int m) { return m >= 0; });
  if (!has_materials) mesh_.face_materials.clear();
  const auto missing = static_cast<std::size_t>(std::count_if(mesh_.normals.begin(), mesh_.normals.end(),
                                                              [](const Eigen::Vector3f& n) { return n.isZero(0.0f); }));
  if (missing > 0) {
    const std::vector<Eigen::Vector3f> computed = vertex_normals(mesh_.vertices, mesh_.faces);
    for (std::size_t v = 0; v < computed.size(); ++v) {
      if (mesh_.normals[v].isZero(0.0f)) mesh_.normals[v] = computed[v];
    }
    notes.tally("computed_normals", "vertices without a usable normal got the one of their faces", missing);
  }
  return std::move(mesh_);
}

}  // namespace anigen::io::gltf_import
