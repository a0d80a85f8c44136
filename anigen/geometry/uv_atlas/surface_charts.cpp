#include "anigen/geometry/uv_atlas/surface_charts.h"

#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/uv_atlas/chart_growing.h"

namespace anigen::geometry {

SurfaceFaces::SurfaceFaces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  for (const Triangle& face : faces) {
    const Eigen::Vector3d a = vertices[at(face[0])].cast<double>();
    const Eigen::Vector3d b = vertices[at(face[1])].cast<double>(), c = vertices[at(face[2])].cast<double>();
    const Eigen::Vector3d twice = (b - a).cross(c - a);
    const double length = twice.norm();
    areas.push_back(0.5 * length);
    normals.push_back(length > 0.0 ? Eigen::Vector3d(twice / length) : Eigen::Vector3d::Zero());
    centroids.push_back((a + b + c) / 3.0);
  }
}

Eigen::Vector3d mean_normal(const SurfaceFaces& surface, const std::vector<std::int32_t>& faces) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const std::int32_t face : faces) sum += surface.areas[at(face)] * surface.normals[at(face)];
  const double length = sum.norm();
  return length > 0.0 ? Eigen::Vector3d(sum / length) : Eigen::Vector3d::Zero();
}

std::vector<SurfaceChart> surface_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                         double max_deviation) {
  const double least_cosine = std::cos(max_deviation);
  std::vector<SurfaceChart> charts;
  for (std::vector<std::int32_t>& group :
       merge_charts(surface, adjacency, least_cosine, grow_charts(surface, adjacency, least_cosine))) {
    Eigen::Vector3d axis = mean_normal(surface, group);
    // Nothing but faces without area: any direction will do.
    if (axis.isZero()) axis = Eigen::Vector3d::UnitZ();
    charts.push_back({std::move(group), axis});
  }
  return charts;
}

}  // namespace anigen::geometry
