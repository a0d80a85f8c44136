#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen {

/// The edges of a triangle mesh, without direction, and the faces at each: any number of them. Edges are numbered in
/// the order of (lower vertex, higher vertex). The side of a face that names a vertex twice is no edge.
class MeshEdges {
 public:
  using Edge = std::array<std::int32_t, 2>;  ///< lower vertex first

  struct Faces {
    const std::int32_t *first, *last;
    const std::int32_t* begin() const { return first; }
    const std::int32_t* end() const { return last; }
    std::size_t size() const { return static_cast<std::size_t>(last - first); }
  };

  /// @throws InputError when a face refers to a vertex that is missing
  MeshEdges(const std::vector<Triangle>& faces, std::size_t vertices);

  std::size_t size() const { return edges_.size(); }
  const Edge& operator[](std::size_t edge) const { return edges_[edge]; }
  const std::vector<Edge>& all() const { return edges_; }
  /// Ascending; a face that has the edge twice is listed twice.
  Faces faces(std::size_t edge) const { return {faces_.data() + offsets_[edge], faces_.data() + offsets_[edge + 1]}; }
  /// The edge from corner `side` of a face to the next corner; -1 where both are one vertex.
  std::int32_t of_face(std::size_t face, std::size_t side) const { return of_face_[face][side]; }
  /// -1 when no face has this edge. @pre both are vertices of the mesh
  std::int32_t find(std::int32_t a, std::int32_t b) const;

 private:
  std::vector<Edge> edges_;
  std::vector<std::size_t> offsets_{0};  ///< [E + 1]
  std::vector<std::int32_t> faces_;
  std::vector<Triangle> of_face_;        ///< [F], edges in place of vertices
  std::vector<std::size_t> first_edge_;  ///< [V + 1], by lower vertex
};

}  // namespace anigen
