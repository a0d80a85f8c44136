#include "anigen/geometry/boundary_loops.h"

#include <algorithm>
#include <unordered_set>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr std::int32_t kNone = -1;

class BorderWalk {
 public:
  BorderWalk(const std::vector<Triangle>& faces, const MeshEdges& edges)
      : faces_(faces), edges_(edges), visited_(edges.size(), 0) {}

  BoundaryLoops run() {
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (edges_.faces(e).size() != 1 || visited_[e] != 0) continue;
      std::vector<std::int32_t> walk;
      if (follow(static_cast<std::int32_t>(e), walk)) {
        split(walk);
      } else {
        ++result_.broken;
      }
    }
    return std::move(result_);
  }

 private:
  /// The only face of a border edge.
  std::int32_t face_of(std::int32_t edge) const { return *edges_.faces(at(edge)).first; }

  /// Start and end of a border edge in the direction of its face.
  std::pair<std::int32_t, std::int32_t> directed(std::int32_t edge) const {
    const std::size_t face = at(face_of(edge));
    std::size_t side = 0;
    while (edges_.of_face(face, side) != edge) ++side;
    return {faces_[face][side], faces_[face][(side + 1) % 3]};
  }

  /// The side of the face that is not `edge` but ends in `pivot` too.
  std::int32_t other_side(std::int32_t face, std::int32_t edge, std::int32_t pivot) const {
    for (std::size_t side = 0; side < 3; ++side) {
      const std::int32_t other = edges_.of_face(at(face), side);
      if (other == edge) continue;
      const MeshEdges::Edge& ends = edges_[at(other)];
      if (ends[0] == pivot || ends[1] == pivot) return other;
    }
    return kNone;
  }

  /// The border edge at the other end of the faces around `pivot` that begin with this one; kNone when they end at an
  /// edge of more than two faces.
  std::int32_t next_border(std::int32_t edge, std::int32_t pivot) const {
    std::int32_t face = face_of(edge);
    for (;;) {
      edge = other_side(face, edge, pivot);
      const MeshEdges::Faces both = edges_.faces(at(edge));
      if (both.size() == 1) return edge;
      if (both.size() > 2) return kNone;
      face = both.first[0] == face ? both.first[1] : both.first[0];
    }
  }

  /// Walks from an edge back to it and marks what it passes. @return false when that is not possible
  bool follow(std::int32_t start, std::vector<std::int32_t>& walk) {
    std::int32_t edge = start;
    do {
      visited_[at(edge)] = 1;
      const auto [from, to] = directed(edge);
      walk.push_back(from);
      const std::int32_t next = next_border(edge, to);
      if (next == kNone) return false;
      if (directed(next).first != to) return false;  // these faces disagree about which side is up
      edge = next;
    } while (visited_[at(edge)] == 0);
    return edge == start;
  }

  /// Cuts a walk where it comes back to a vertex, so that every loop passes each vertex once.
  void split(const std::vector<std::int32_t>& walk) {
    std::vector<std::int32_t> open;
    std::unordered_set<std::int32_t> is_open;
    for (const std::int32_t vertex : walk) {
      if (!is_open.insert(vertex).second) {
        const auto before = std::find(open.begin(), open.end(), vertex);
        for (auto after = before + 1; after != open.end(); ++after) is_open.erase(*after);
        add({before, open.end()});
        open.erase(before, open.end());
      }
      open.push_back(vertex);
    }
    add(std::move(open));
  }

  void add(std::vector<std::int32_t> loop) {
    if (loop.size() >= 3) result_.loops.push_back(std::move(loop));
  }

  const std::vector<Triangle>& faces_;
  const MeshEdges& edges_;
  std::vector<char> visited_;
  BoundaryLoops result_;
};

}  // namespace

BoundaryLoops boundary_loops(const std::vector<Triangle>& faces, const MeshEdges& edges) {
  return BorderWalk(faces, edges).run();
}

}  // namespace anigen::geometry
