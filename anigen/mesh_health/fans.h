#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::mesh_health {

/// A soup of triangles with copies of vertices where surfaces meet.
struct PartedFaces {
  std::vector<Eigen::Vector3f> vertices;  ///< the old ones first
  std::vector<Triangle> faces;            ///< in their order
};

/// Parts the surfaces that meet at an edge of more than two faces, and the fans that meet at a vertex: only faces that
/// continue each other still share vertices. At such an edge two faces continue each other when they bound one piece of
/// the solid that the faces enclose there; where the faces bound none, those of opposite direction that hang together
/// elsewhere, then those that bend least. One that is left over gets a border. Edges of two faces stay, also of faces
/// that disagree about the outside.
///
/// The edge stays as it is where both its ends hang together around it, as where a solid touches itself.
/// @pre no face names a vertex twice
PartedFaces part_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

}  // namespace anigen::mesh_health
