#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::mesh_health {

/// Pieces of a surface that hang together by edges.
struct Parts {
  std::vector<std::size_t> of_face;  ///< [F] numbered in the order of their first faces
  std::vector<char> closed;          ///< [parts] not 0: every edge has exactly two faces, of opposite directions
  std::vector<double> volumes;       ///< [parts] signed, about the middle of the part's box; of closed parts a volume
  std::vector<Box> boxes;            ///< [parts]

  std::size_t size() const { return closed.size(); }
  /// Closed and wound inward, without being a cavity: no other closed part's box has this one's inside.
  bool is_inverted(std::size_t part) const;
};

Parts find_parts(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                 const MeshEdges& edges);

/// Turns closed parts over that are wound inward (Parts::is_inverted). @return how many
/// @pre every edge has one or two faces
std::size_t turn_outward(Mesh& mesh);

/// True when the first of two faces runs along an edge of both from its lower vertex to its higher one.
bool runs_upward(const Triangle& face, const MeshEdges::Edge& edge);

}  // namespace anigen::mesh_health
