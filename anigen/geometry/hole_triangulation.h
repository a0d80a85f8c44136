#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// A hole as a closed polygon and what surrounds it.
struct HoleOutline {
  std::vector<Eigen::Vector3d> points;   ///< [n] along the hole, against the direction of the faces around it
  std::vector<Eigen::Vector3d> outside;  ///< [n] unit normal of the face beyond the edge from point i to the next
  /// Whether an edge between two points of the outline that are not next to each other may be made.
  std::function<bool(std::int32_t, std::int32_t)> may_connect;
};

/// The triangulation of a hole without new points that bends least: the one with the smallest of the largest angles
/// between faces that share an edge, of equal ones the one with the least area (Barequet and Sharir 1995 with the
/// weights of Liepa 2003). Time grows with n³, memory with n².
/// @return n − 2 triangles of indices into the outline, in its direction; empty when the forbidden edges leave none
/// @pre at least 3 points
std::vector<Triangle> triangulate_hole(const HoleOutline& hole);

}  // namespace anigen::geometry
