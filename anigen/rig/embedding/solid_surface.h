#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/normalize.h"

namespace anigen::rig {

/// The triangles of a mesh as solids need them: corners in one place are one vertex (files split them at texture
/// seams), what no face uses is gone, and so are faces without three different corners, unless there are no others.
struct SolidSurface {
  std::vector<Eigen::Vector3d> vertices;  ///< centre of the box at the origin, longest side as asked for
  std::vector<Triangle> faces;
  std::vector<std::vector<int>> parts;  ///< faces that hang together by vertices, largest area first
  Similarity from_mesh;                 ///< mesh → vertices
};

/// @param size longest side of the result's box
/// @throws InputError for a mesh without faces or without extent, a face that refers to a missing vertex, or a vertex
/// of a face that is not finite
SolidSurface solid_surface(const Mesh& mesh, double size);

}  // namespace anigen::rig
