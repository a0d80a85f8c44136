#include "anigen/asset/mesh.h"

#include <cmath>

namespace anigen {

Box bounding_box(const std::vector<Eigen::Vector3f>& points) {
  Box box;
  for (const Eigen::Vector3f& p : points) box.extend(p.cast<double>());
  return box;
}

std::vector<Eigen::Vector3f> vertex_normals(const std::vector<Eigen::Vector3f>& vertices,
                                            const std::vector<Triangle>& faces) {
  std::vector<Eigen::Vector3d> sums(vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : faces) {
    const Eigen::Vector3d a = vertices[face[0]].cast<double>();
    // The cross product's length is twice the area: large faces count more.
    const Eigen::Vector3d normal = (vertices[face[1]].cast<double>() - a).cross(vertices[face[2]].cast<double>() - a);
    for (const int corner : face) sums[corner] += normal;
  }
  std::vector<Eigen::Vector3f> normals(vertices.size(), Eigen::Vector3f::UnitZ());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const double length = sums[v].norm();
    if (length > 0.0 && std::isfinite(length)) normals[v] = (sums[v] / length).cast<float>();
  }
  return normals;
}

}  // namespace anigen
