#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Which faces of a surface share an edge. Vertices at exactly the same position count as one, so that a mesh split
/// along texture seams or hard edges is still connected there.
class FaceAdjacency {
 public:
  struct Link {
    std::int32_t face;  ///< on the other side of the edge
    double length;      ///< of the edge
  };
  struct Links {
    const Link* first;
    const Link* last;
    const Link* begin() const { return first; }
    const Link* end() const { return last; }
  };

  /// @param faces valid indices
  FaceAdjacency(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  /// Neighbours across every edge of the face, by face number; a face that shares two edges comes twice. Edges with
  /// more than two faces link all of them, or, beyond a handful, each to the next one only.
  Links of(std::int32_t face) const;

  /// The parts of a set of faces that hang together by edges within it, each ascending, ordered by first face.
  std::vector<std::vector<std::int32_t>> connected_pieces(std::vector<std::int32_t> faces) const;

 private:
  std::vector<std::size_t> offsets_;  ///< [F + 1]
  std::vector<Link> links_;
};

}  // namespace anigen::geometry
