#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen {

/// The shells of a mesh: faces that hang together. Faces that name a vertex together belong to one shell, and so do two
/// that meet at an edge of equal places, since files split vertices at texture seams and hard edges. Where parts touch,
/// more faces meet at an edge: then those hang together between which a solid lies, as their directions say (counter-
/// clockwise seen from outside); of an edge where that says nothing all do.
struct MeshShells {
  std::size_t count = 0;
  std::vector<std::int32_t> of_face;    ///< [F], numbered by their lowest face
  std::vector<std::int32_t> of_vertex;  ///< [V]; -1 for a vertex without faces
};

/// @throws InputError when a face refers to a vertex that is missing
MeshShells mesh_shells(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

}  // namespace anigen
