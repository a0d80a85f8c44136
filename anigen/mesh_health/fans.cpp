#include "anigen/mesh_health/fans.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"
#include "anigen/mesh_health/parts.h"

namespace anigen::mesh_health {

namespace {

/// A face at an edge, seen along the edge from its higher vertex to its lower one.
struct Leaf {
  std::int32_t face;
  bool upward;   ///< it runs along the edge from the lower vertex to the higher one
  double angle;  ///< counter-clockwise, in [-π, π]
};

using FacePairs = std::vector<std::pair<std::int32_t, std::int32_t>>;

std::vector<Leaf> leaves_of(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                            const MeshEdges& edges, std::size_t edge) {
  const std::int32_t low = edges[edge][0], high = edges[edge][1];  // a lambda takes them
  const Eigen::Vector3d start = vertices[at(low)].cast<double>();
  const Eigen::Vector3d axis = (vertices[at(high)].cast<double>() - start).normalized();
  const Eigen::Vector3d side = axis.unitOrthogonal(), other = axis.cross(side);
  std::vector<Leaf> leaves;
  for (const std::int32_t face : edges.faces(edge)) {
    const Triangle& t = faces[at(face)];
    const auto apex = std::find_if(t.begin(), t.end(), [&](std::int32_t v) { return v != low && v != high; });
    const Eigen::Vector3d arm = vertices[at(*apex)].cast<double>() - start;
    leaves.push_back({face, runs_upward(t, edges[edge]), std::atan2(arm.dot(other), arm.dot(side))});
  }
  std::sort(leaves.begin(), leaves.end(),
            [](const Leaf& a, const Leaf& b) { return std::tie(a.angle, a.face) < std::tie(b.angle, b.face); });
  return leaves;
}

/// Pairs with the solid between them. The normal of a face that runs upward is a quarter turn counter-clockwise of it,
/// so the solid lies on its clockwise side, and ends at the face before it, which must run downward.
/// @return none unless all faces pair
FacePairs pairs_around_solids(const std::vector<Leaf>& leaves) {
  FacePairs pairs;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const Leaf& before = leaves[(i + leaves.size() - 1) % leaves.size()];
    if (leaves[i].upward == before.upward) return {};
    if (leaves[i].upward) pairs.emplace_back(before.face, leaves[i].face);
  }
  return pairs;
}

/// @param pieces of faces that hang together by edges of two faces: a wall must not part the shell around it
FacePairs likeliest_pairs(const std::vector<Leaf>& leaves, DisjointSets& pieces) {
  std::vector<std::tuple<bool, double, std::size_t, std::size_t>> candidates;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    for (std::size_t j = i + 1; j < leaves.size(); ++j) {
      if (leaves[i].upward != leaves[j].upward)
        candidates.emplace_back(!pieces.same(at(leaves[i].face), at(leaves[j].face)),
                                std::abs(leaves[j].angle - leaves[i].angle - kPi), i, j);
    }
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<char> taken(leaves.size(), 0);
  FacePairs pairs;
  for (const auto& [elsewhere, bend, i, j] : candidates) {
    if (taken[i] != 0 || taken[j] != 0) continue;
    taken[i] = taken[j] = 1;
    pairs.emplace_back(leaves[i].face, leaves[j].face);
  }
  return pairs;
}

FacePairs pairs_at(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                   const MeshEdges& edges, std::size_t edge, DisjointSets& pieces) {
  const auto around = edges.faces(edge);
  if (around.size() < 2) return {};
  if (around.size() == 2) return {{around.begin()[0], around.begin()[1]}};
  // All pairs are listed, and a soup that has thousands of faces at an edge is no surface.
  constexpr std::size_t kMostFaces = 64;
  if (around.size() > kMostFaces) return {};
  const std::vector<Leaf> leaves = leaves_of(vertices, faces, edges, edge);
  FacePairs pairs = pairs_around_solids(leaves);
  return pairs.empty() ? likeliest_pairs(leaves, pieces) : pairs;
}

}  // namespace

PartedFaces part_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  const MeshEdges edges(faces, vertices.size());
  DisjointSets pieces(faces.size());
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto around = edges.faces(e);
    if (around.size() == 2) pieces.join_lowest(at(around.begin()[0]), at(around.begin()[1]));
  }
  DisjointSets corners(3 * faces.size());
  const auto corner = [&](std::int32_t face, std::int32_t vertex) {
    const Triangle& t = faces[at(face)];
    return 3 * at(face) + static_cast<std::size_t>(std::find(t.begin(), t.end(), vertex) - t.begin());
  };
  for (std::size_t e = 0; e < edges.size(); ++e) {
    for (const auto& [first, second] : pairs_at(vertices, faces, edges, e, pieces))
      for (const std::int32_t vertex : edges[e]) corners.join_lowest(corner(first, vertex), corner(second, vertex));
  }
  PartedFaces parted{vertices, faces};
  std::vector<char> taken(vertices.size(), 0);
  std::map<std::size_t, std::int32_t> copies;  // of fans that are not the first of their vertex
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t fan = corners.find(3 * f + k);
      const auto known = copies.find(fan);
      if (known != copies.end()) {
        parted.faces[f][k] = known->second;
      } else if (fan == 3 * f + k) {
        const std::int32_t vertex = faces[f][k];
        if (taken[at(vertex)] == 0) {
          taken[at(vertex)] = 1;
          continue;
        }
        parted.faces[f][k] = copies[fan] = static_cast<std::int32_t>(parted.vertices.size());
        parted.vertices.push_back(vertices[at(vertex)]);
      }
    }
  }
  return parted;
}

}  // namespace anigen::mesh_health
