#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rig {

/// A mesh as binding sees it. Vertices at exactly the same position are one place, so that texture seams neither part a
/// surface nor its weights, and everything is sorted, so that results do not depend on the order of vertices and faces.
/// Unit frame: the middle of the box around the faces is the origin, its longest side is 1.
struct WeldedSurface {
  std::vector<Eigen::Vector3d> places;  ///< [P] unit frame, in lexicographic order
  std::vector<std::int32_t> of_vertex;  ///< [V] the place of each vertex
  std::vector<Triangle> faces;          ///< of places; three different ones each, no set of three twice
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double size = 1.0;  ///< longest side; 1 when the faces have no extent, as has_extent says
  bool has_extent = false;

  Eigen::Vector3d to_unit(const Eigen::Vector3d& point) const { return (point - center) / size; }
};

/// @throws InputError naming a vertex that is not finite or a face that refers to a missing one
WeldedSurface weld_surface(const Mesh& mesh);

/// Rows of places as rows of vertices.
SkinWeights rows_of_vertices(const SkinWeights& rows_of_places, const WeldedSurface& surface);

}  // namespace anigen::rig
