#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/uv_atlas/surface_charts.h"

namespace anigen::geometry {

/// A chart laid out flat, in the unit of the mesh: projected along its axis, turned so that its box is the smallest of
/// all rectangles around it and lies on its longer side, the box' lower left corner at the origin. Seen from outside,
/// not mirrored: triangles run counter-clockwise.
struct PlanarChart {
  SurfaceChart chart;
  std::vector<std::int32_t> vertices;   ///< of the mesh, one per point
  std::vector<Eigen::Vector2d> points;  ///< in [0, extent]
  std::vector<Triangle> triangles;      ///< into points, in the order of chart.faces
  Eigen::Vector3d right, up;            ///< unit vectors of the plane in the mesh's frame
  Eigen::Vector2d extent;               ///< width ≥ height
  double area = 0.0;                    ///< of the triangles
};

PlanarChart planar_chart(SurfaceChart chart, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces);

}  // namespace anigen::geometry
