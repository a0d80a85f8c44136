#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/rig/embedding/solid_field.h"

namespace anigen::rig {

/// A closed, oriented two-manifold of one piece.
struct ClosedMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;  ///< counter-clockwise from outside
  double volume = 0.0;
};

/// The boundary of a solid, by marching tetrahedra (Doi and Koide 1991; six to a cell along its diagonal, which needs
/// no cases and cannot give a surface that is not closed), cut into its pieces, largest volume first. Walls of cavities
/// are left out. The frame is the field's.
std::vector<ClosedMesh> solid_pieces(const SolidField& field);

/// The same surface with fewer vertices (geometry/simplify.h), still closed. @param target_vertices at least 4
ClosedMesh with_fewer_vertices(const ClosedMesh& mesh, std::size_t target_vertices);

}  // namespace anigen::rig
