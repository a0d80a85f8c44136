#include "anigen/geometry/edge_collapse.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

/// A face may turn by less than the angle of this cosine in one collapse.
constexpr double kLeastCosine = 0.2;
/// Twice the area over the squared longest side below which a face counts as a sliver: it has no normal to keep, and
/// none may be made.
constexpr double kSliver = 1e-4;

bool is_sliver(const Eigen::Vector3d& ab, const Eigen::Vector3d& ac, double twice_area) {
  const double longest = std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()});
  return !(twice_area > kSliver * longest);
}

}  // namespace

CollapsibleMesh::CollapsibleMesh(std::vector<Eigen::Vector3d> positions, std::vector<Triangle> faces,
                                 const MeshEdges& edges)
    : positions_(std::move(positions)),
      faces_(std::move(faces)),
      dead_(faces_.size(), 0),
      border_(positions_.size(), 0),
      locked_(positions_.size(), 0),
      first_corner_(positions_.size(), kNone),
      next_corner_(3 * faces_.size()),
      mark_(positions_.size(), 0),
      live_faces_(faces_.size()) {
  for (std::size_t corner = 0; corner < next_corner_.size(); ++corner) {
    std::int32_t& first = first_corner_[at(faces_[corner / 3][corner % 3])];
    next_corner_[corner] = first;
    first = static_cast<std::int32_t>(corner);
  }
  for (std::size_t e = 0; e < edges.size(); ++e) {
    for (const std::int32_t vertex : edges[e]) {
      if (edges.faces(e).size() == 1) border_[at(vertex)] = 1;
      if (edges.faces(e).size() > 2) locked_[at(vertex)] = 1;
    }
  }
}

template <typename Visit>
bool CollapsibleMesh::each_corner(std::int32_t vertex, const Visit& visit) {
  std::int32_t* link = &first_corner_[at(vertex)];
  while (*link != kNone) {
    const std::size_t corner = at(*link);
    if (dead_[corner / 3] != 0) {
      *link = next_corner_[corner];
      continue;
    }
    if (!visit(corner / 3, corner % 3)) return false;
    link = &next_corner_[corner];
  }
  return true;
}

const std::vector<std::int32_t>& CollapsibleMesh::neighbours(std::int32_t vertex) {
  neighbours_.clear();
  ++collection_;
  each_corner(vertex, [&](std::size_t face, std::size_t corner) {
    for (const std::size_t step : {1u, 2u}) {
      const std::int32_t other = faces_[face][(corner + step) % 3];
      if (std::exchange(mark_[at(other)], collection_) != collection_) neighbours_.push_back(other);
    }
    return true;
  });
  return neighbours_;
}

bool CollapsibleMesh::keeps_topology(std::int32_t a, std::int32_t b) {
  std::size_t faces_of_a = 0, faces_of_b = 0;
  std::array<std::int32_t, 2> apexes{kNone, kNone};  // third corners of the faces at the edge
  std::size_t shared_faces = 0;
  each_corner(a, [&](std::size_t face, std::size_t corner) {
    ++faces_of_a;
    const std::int32_t second = faces_[face][(corner + 1) % 3], third = faces_[face][(corner + 2) % 3];
    if (second != b && third != b) return true;
    if (shared_faces < 2) apexes[shared_faces] = second == b ? third : second;
    ++shared_faces;
    return true;
  });
  if (shared_faces == 0 || shared_faces > 2 || apexes[0] == apexes[1]) return false;
  // Two borders that meet in an edge inside the surface would pinch it.
  if (shared_faces == 2 && on_border(a) && on_border(b)) return false;
  // The link condition: besides the faces' third corners there is no vertex next to both.
  neighbours(a);
  const std::uint32_t next_to_a = collection_;
  const bool has_others = !each_corner(b, [&](std::size_t face, std::size_t corner) {
    ++faces_of_b;
    for (const std::size_t step : {1u, 2u}) {
      const std::int32_t other = faces_[face][(corner + step) % 3];
      if (mark_[at(other)] == next_to_a && other != apexes[0] && other != apexes[1]) return false;
    }
    return true;
  });
  if (has_others) return false;
  // A tetrahedron satisfies the condition and would become two faces on top of each other; a lone triangle nothing.
  if (shared_faces == 2 && faces_of_a == 3 && faces_of_b == 3) return false;
  return faces_of_a + faces_of_b > 2 * shared_faces;
}

bool CollapsibleMesh::turns_a_face(std::int32_t vertex, std::int32_t other, const Eigen::Vector3d& target) {
  return !each_corner(vertex, [&](std::size_t face, std::size_t corner) {
    const std::int32_t second = faces_[face][(corner + 1) % 3], third = faces_[face][(corner + 2) % 3];
    if (second == other || third == other) return true;
    const Eigen::Vector3d &b = position(second), &c = position(third);
    const Eigen::Vector3d old_b = b - position(vertex), old_c = c - position(vertex);
    const Eigen::Vector3d new_b = b - target, new_c = c - target;
    const Eigen::Vector3d before = old_b.cross(old_c), after = new_b.cross(new_c);
    const double old_length = before.norm(), new_length = after.norm();
    if (is_sliver(old_b, old_c, old_length)) return true;
    return !is_sliver(new_b, new_c, new_length) && before.dot(after) > kLeastCosine * old_length * new_length;
  });
}

bool CollapsibleMesh::collapse(std::int32_t a, std::int32_t b, const Eigen::Vector3d& target) {
  if (is_locked(a) || is_locked(b) || !keeps_topology(a, b)) return false;
  if (turns_a_face(a, b, target) || turns_a_face(b, a, target)) return false;
  std::int32_t last = kNone;
  each_corner(b, [&](std::size_t face, std::size_t corner) {
    if (std::find(faces_[face].begin(), faces_[face].end(), a) != faces_[face].end()) {
      dead_[face] = 1;
      --live_faces_;
    } else {
      faces_[face][corner] = a;
    }
    last = static_cast<std::int32_t>(3 * face + corner);
    return true;
  });
  next_corner_[at(last)] = std::exchange(first_corner_[at(a)], std::exchange(first_corner_[at(b)], kNone));
  border_[at(a)] |= border_[at(b)];
  positions_[at(a)] = target;
  return true;
}

}  // namespace anigen::geometry
