#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::curve_skeleton {

/// @throws InputError naming what keeps the mesh from being one closed, oriented two-manifold: an index out of range, a
/// position that is not finite, a face with a vertex twice, an edge without exactly two faces of opposite direction, a
/// vertex without a face or with several fans of them, several pieces
void require_closed_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces);

}  // namespace anigen::curve_skeleton
