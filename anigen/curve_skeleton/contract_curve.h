#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::curve_skeleton {

/// What a surface was contracted to.
struct CurveGraph {
  std::vector<Eigen::Vector3d> points;    ///< the mesh's frame
  std::vector<std::array<int, 2>> edges;  ///< without direction; a surface with handles gives cycles
  std::vector<int> point_of_vertex;       ///< [V], the point that a vertex of the surface went to
};

struct ContractionOptions {
  std::size_t most_iterations = 300;  ///< of the flow; it ends by itself when the area hardly shrinks any more
  double speed = 0.1;                 ///< CGAL's quality_speed_tradeoff: lower is smoother and slower
  double centering = 0.2;             ///< CGAL's medially_centered_speed_tradeoff: higher is nearer to the medial axis
};

/// Whether contract_curve() is there: built with CMake option ANIGEN_WITH_CGAL, which makes a program GPL-3.
bool can_contract();

/// Contracts a surface to a curve by mean curvature flow (Tagliasacchi et al. 2012, "Mean curvature skeletons", as
/// CGAL's package Surface_mesh_skeletonization has it). The same input gives the same result.
/// @throws NotSupportedError naming the option, where can_contract() is false
/// @throws InputError unless every edge has two faces that run along it in opposite directions, every vertex one fan
/// of faces, and all faces hang together; for positions that are not finite; for fewer than 4 faces
/// @throws Error when CGAL gives up, Interrupted between steps of the flow
CurveGraph contract_curve(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                          const ContractionOptions& options = {});

}  // namespace anigen::curve_skeleton
