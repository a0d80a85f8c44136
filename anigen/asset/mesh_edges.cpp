#include "anigen/asset/mesh_edges.h"

#include <algorithm>
#include <string>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen {
namespace {

/// One side of a face, filed under the lower of its two vertices.
struct Side {
  std::int32_t higher, face;
  std::uint8_t corner;

  bool operator<(const Side& other) const {
    return std::tie(higher, face, corner) < std::tie(other.higher, other.face, other.corner);
  }
};

void check_indices(const std::vector<Triangle>& faces, std::size_t vertices) {
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t vertex : faces[f]) {
      if (vertex >= 0 && at(vertex) < vertices) continue;
      throw InputError("", "faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(vertex));
    }
  }
}

template <typename Body>
void each_side(const std::vector<Triangle>& faces, const Body& body) {
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::uint8_t k = 0; k < 3; ++k) {
      const std::int32_t a = faces[f][k], b = faces[f][(k + 1u) % 3u];
      if (a != b) body(std::min(a, b), Side{std::max(a, b), static_cast<std::int32_t>(f), k});
    }
  }
}

}  // namespace

MeshEdges::MeshEdges(const std::vector<Triangle>& faces, std::size_t vertices)
    : of_face_(faces.size(), Triangle{-1, -1, -1}), first_edge_(vertices + 1, 0) {
  check_indices(faces, vertices);
  std::vector<std::size_t> begin(vertices + 1, 0);
  each_side(faces, [&](std::int32_t lower, const Side&) { ++begin[at(lower) + 1]; });
  for (std::size_t v = 0; v < vertices; ++v) begin[v + 1] += begin[v];
  std::vector<Side> sides(begin.back());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  each_side(faces, [&](std::int32_t lower, const Side& side) { sides[next[at(lower)]++] = side; });
  faces_.reserve(sides.size());
  for (std::size_t v = 0; v < vertices; ++v) {
    first_edge_[v] = edges_.size();
    const auto first = sides.begin() + static_cast<std::ptrdiff_t>(begin[v]);
    const auto last = sides.begin() + static_cast<std::ptrdiff_t>(begin[v + 1]);
    std::sort(first, last);
    for (auto side = first; side != last; ++side) {
      if (side == first || side->higher != std::prev(side)->higher) {
        if (side != first) offsets_.push_back(faces_.size());
        edges_.push_back({static_cast<std::int32_t>(v), side->higher});
      }
      of_face_[at(side->face)][side->corner] = static_cast<std::int32_t>(edges_.size()) - 1;
      faces_.push_back(side->face);
    }
    if (first != last) offsets_.push_back(faces_.size());
  }
  first_edge_[vertices] = edges_.size();
}

std::int32_t MeshEdges::find(std::int32_t a, std::int32_t b) const {
  const Edge edge{std::min(a, b), std::max(a, b)};
  const auto first = edges_.begin() + static_cast<std::ptrdiff_t>(first_edge_[at(edge[0])]);
  const auto last = edges_.begin() + static_cast<std::ptrdiff_t>(first_edge_[at(edge[0]) + 1]);
  const auto found = std::lower_bound(first, last, edge);
  return found != last && *found == edge ? static_cast<std::int32_t>(found - edges_.begin()) : -1;
}

}  // namespace anigen
