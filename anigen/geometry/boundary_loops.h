#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/mesh_edges.h"

namespace anigen::geometry {

struct BoundaryLoops {
  /// Vertices along each hole, at least three and none twice, in the direction of the sides of the faces around it: a
  /// face that closes part of the hole has to run against it. Where holes touch themselves in a vertex they are
  /// several.
  std::vector<std::vector<std::int32_t>> loops;
  std::size_t broken = 0;  ///< borders that run into an edge of more than two faces or along faces that disagree about
                           ///< which side is up: they surround nothing that a face could close
};

/// The closed walks along edges with one face. @param edges of these faces @pre no face names a vertex twice
BoundaryLoops boundary_loops(const std::vector<Triangle>& faces, const MeshEdges& edges);

}  // namespace anigen::geometry
