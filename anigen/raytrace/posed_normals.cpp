#include "anigen/raytrace/posed_normals.h"

#include <Eigen/Geometry>

namespace anigen::raytrace {
namespace {

/// `vector` turned by the smallest rotation that takes unit `from` to unit `to` (Rodrigues' formula without angles).
Eigen::Vector3f turned(const Eigen::Vector3f& vector, const Eigen::Vector3f& from, const Eigen::Vector3f& to) {
  const Eigen::Vector3f axis = from.cross(to);  // length: the sine
  const float cosine = from.dot(to);
  if (cosine < -0.9999f) return -vector;  // half a turn about an axis that is not determined
  return cosine * vector + axis.cross(vector) + axis.dot(vector) / (1.0f + cosine) * axis;
}

}  // namespace

std::vector<Eigen::Vector3f> posed_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& vertices) {
  const std::vector<Eigen::Vector3f> after = vertex_normals(vertices, mesh.faces);
  if (mesh.normals.empty()) return after;
  const std::vector<Eigen::Vector3f> before = vertex_normals(mesh.vertices, mesh.faces);
  std::vector<Eigen::Vector3f> normals(vertices.size());
  for (std::size_t v = 0; v < normals.size(); ++v) {
    normals[v] = turned(mesh.normals[v], before[v], after[v]);
  }
  return normals;
}

}  // namespace anigen::raytrace
