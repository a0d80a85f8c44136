#include "anigen/geometry/uv_atlas/face_adjacency.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr std::size_t kMostFacesLinkedAtOnce = 8;  ///< pairs grow with the square

struct FaceEdge {
  std::int32_t low, high;  ///< welded vertices
  std::int32_t face;
  double length;
  bool operator<(const FaceEdge& other) const {
    return std::tie(low, high, face) < std::tie(other.low, other.high, other.face);
  }
  bool same_place(const FaceEdge& other) const { return low == other.low && high == other.high; }
};

bool position_before(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::make_tuple(a.x(), a.y(), a.z()) < std::make_tuple(b.x(), b.y(), b.z());
}

/// A number per vertex, the same for vertices at the same position.
std::vector<std::int32_t> welded_vertices(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<std::int32_t> order(vertices.size()), welded(vertices.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::int32_t a, std::int32_t b) { return position_before(vertices[at(a)], vertices[at(b)]); });
  std::int32_t number = -1;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_new = i == 0 || position_before(vertices[at(order[i - 1])], vertices[at(order[i])]);
    welded[at(order[i])] = is_new ? ++number : number;
  }
  return welded;
}

std::vector<FaceEdge> sorted_edges(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  const std::vector<std::int32_t> welded = welded_vertices(vertices);
  std::vector<FaceEdge> edges;
  edges.reserve(3 * faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t from = faces[f][k], to = faces[f][(k + 1) % 3];
      const auto [low, high] = std::minmax(welded[at(from)], welded[at(to)]);
      if (low == high) continue;
      const double length = (vertices[at(to)].cast<double>() - vertices[at(from)].cast<double>()).norm();
      edges.push_back({low, high, static_cast<std::int32_t>(f), length});
    }
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// Calls visit(face, other face, length of the edge) for both directions of every pair.
template <typename Visit>
void for_each_linked_pair(const std::vector<FaceEdge>& edges, Visit&& visit) {
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].same_place(edges[begin])) ++end;
    const std::size_t reach = end - begin <= kMostFacesLinkedAtOnce ? end - begin : 2;
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t k = i + 1; k < std::min(end, i + reach); ++k) {
        if (edges[i].face == edges[k].face) continue;
        visit(edges[i].face, edges[k].face, edges[i].length);
        visit(edges[k].face, edges[i].face, edges[i].length);
      }
    }
  }
}

}  // namespace

FaceAdjacency::FaceAdjacency(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
    : offsets_(faces.size() + 1, 0) {
  const std::vector<FaceEdge> edges = sorted_edges(vertices, faces);
  for_each_linked_pair(edges, [&](std::int32_t face, std::int32_t, double) { ++offsets_[at(face) + 1]; });
  std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
  links_.resize(offsets_.back());
  std::vector<std::size_t> next(offsets_.begin(), offsets_.end() - 1);
  for_each_linked_pair(edges, [&](std::int32_t face, std::int32_t other, double length) {
    links_[next[at(face)]++] = {other, length};
  });
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const auto begin = links_.begin() + static_cast<std::ptrdiff_t>(offsets_[f]);
    const auto end = links_.begin() + static_cast<std::ptrdiff_t>(offsets_[f + 1]);
    std::sort(begin, end,
              [](const Link& a, const Link& b) { return std::tie(a.face, a.length) < std::tie(b.face, b.length); });
  }
}

FaceAdjacency::Links FaceAdjacency::of(std::int32_t face) const {
  return {links_.data() + offsets_[at(face)], links_.data() + offsets_[at(face) + 1]};
}

std::vector<std::vector<std::int32_t>> FaceAdjacency::connected_pieces(std::vector<std::int32_t> faces) const {
  std::sort(faces.begin(), faces.end());
  std::vector<bool> reached(faces.size(), false);
  std::vector<std::vector<std::int32_t>> pieces;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    if (reached[i]) continue;
    reached[i] = true;
    std::vector<std::int32_t> piece = {faces[i]};
    for (std::size_t next = 0; next < piece.size(); ++next) {
      for (const Link& link : of(piece[next])) {
        const auto found = std::lower_bound(faces.begin(), faces.end(), link.face);
        if (found == faces.end() || *found != link.face) continue;
        const auto place = static_cast<std::size_t>(found - faces.begin());
        if (reached[place]) continue;
        reached[place] = true;
        piece.push_back(link.face);
      }
    }
    std::sort(piece.begin(), piece.end());
    pieces.push_back(std::move(piece));
  }
  return pieces;
}

}  // namespace anigen::geometry
