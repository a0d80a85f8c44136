#include "anigen/asset/angle_normals.h"

#include <array>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen {

std::vector<Eigen::Vector3f> angle_weighted_normals(const std::vector<Eigen::Vector3f>& vertices,
                                                    const std::vector<Triangle>& faces) {
  std::vector<Eigen::Vector3d> sums(vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : faces) {
    std::array<Eigen::Vector3d, 3> sides;  // side k leads from corner k to the next
    for (std::size_t k = 0; k < 3; ++k) {
      sides[k] = vertices[at(face[(k + 1) % 3])].cast<double>() - vertices[at(face[k])].cast<double>();
    }
    const Eigen::Vector3d normal = sides[0].cross(sides[1]);
    const double twice_area = normal.norm();
    if (!(twice_area > 0.0)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const double angle = std::atan2(twice_area, -sides[k].dot(sides[(k + 2) % 3]));
      sums[at(face[k])] += angle / twice_area * normal;
    }
  }
  std::vector<Eigen::Vector3f> normals(vertices.size(), Eigen::Vector3f::UnitZ());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const double length = sums[v].norm();
    if (length > 0.0 && std::isfinite(length)) normals[v] = (sums[v] / length).cast<float>();
  }
  return normals;
}

}  // namespace anigen
