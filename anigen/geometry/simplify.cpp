#include "anigen/geometry/simplify.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <queue>
#include <string>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/hidden_faces.h"

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

/// A quadratic form x ↦ xᵀ A x − 2 bᵀ x + c that measures squared distances, for edge collapse (Garland and Heckbert
/// 1997). Frame and unit are those of the points.
struct Quadric {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double c = 0.0;

  /// weight · squared distance to the plane through `point` with that unit normal.
  static Quadric plane(const Eigen::Vector3d& normal, const Eigen::Vector3d& point, double weight) {
    const double offset = normal.dot(point);
    return {weight * normal * normal.transpose(), weight * offset * normal, weight * offset * offset};
  }
  /// weight · squared distance to the point.
  static Quadric point(const Eigen::Vector3d& point, double weight) {
    return {weight * Eigen::Matrix3d::Identity(), weight * point, weight * point.squaredNorm()};
  }

  Quadric& operator+=(const Quadric& other) {
    a += other.a;
    b += other.b;
    c += other.c;
    return *this;
  }
  friend Quadric operator+(Quadric first, const Quadric& second) { return first += second; }

  /// Never negative: rounding is cut off.
  double operator()(const Eigen::Vector3d& x) const {
    const double value = x.dot(a * x) - 2.0 * b.dot(x) + c;
    return value > 0.0 ? value : 0.0;
  }
  /// Minimizer of the form. @pre A is invertible, as with any point() in the sum
  Eigen::Vector3d minimum() const { return a.inverse() * b; }
};

/// A triangle mesh whose edges can be collapsed one by one, with the checks that keep its topology. For simplify().
class CollapsibleMesh {
 public:
  /// @param edges of these faces @pre no face names a vertex twice
  CollapsibleMesh(std::vector<Eigen::Vector3d> positions, std::vector<Triangle> faces, const MeshEdges& edges)
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

  std::size_t vertex_count() const { return positions_.size(); }
  std::size_t live_faces() const { return live_faces_; }
  const Eigen::Vector3d& position(std::int32_t vertex) const { return positions_[at(vertex)]; }
  /// True when an edge of this vertex has one face only.
  bool on_border(std::int32_t vertex) const { return border_[at(vertex)] != 0; }
  /// Vertices with an edge of more than two faces, which collapse() leaves alone.
  bool is_locked(std::int32_t vertex) const { return locked_[at(vertex)] != 0; }

  /// Vertices that share an edge with this one, each once, in no particular order; valid until the next call.
  const std::vector<std::int32_t>& neighbours(std::int32_t vertex) {
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

  /// Moves `a` to `target` and makes `b` one with it, unless that changed the topology or turned a face over.
  /// @return whether it was done; `b` then has no faces any more @pre a and b are neighbours
  bool collapse(std::int32_t a, std::int32_t b, const Eigen::Vector3d& target) {
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

  /// All faces there ever were, those that are gone too.
  const std::vector<Triangle>& faces() const { return faces_; }
  bool is_live(std::size_t face) const { return dead_[face] == 0; }

 private:
  static constexpr std::int32_t kNone = -1;

  /// Calls visit(face, corner) for the live faces of a vertex; false from visit ends it. Unlinks dead corners.
  template <typename Visit>
  bool each_corner(std::int32_t vertex, const Visit& visit) {
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
  bool keeps_topology(std::int32_t a, std::int32_t b) {
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
  bool turns_a_face(std::int32_t vertex, std::int32_t other, const Eigen::Vector3d& target) {
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

  std::vector<Eigen::Vector3d> positions_;
  std::vector<Triangle> faces_;
  std::vector<char> dead_, border_, locked_;
  std::vector<std::int32_t> first_corner_;  ///< [V], corner 3 f + k
  std::vector<std::int32_t> next_corner_;   ///< [3F], the next corner at the same vertex
  std::vector<std::int32_t> neighbours_;
  std::vector<std::uint32_t> mark_;  ///< [V], which collection has seen the vertex last
  std::uint32_t collection_ = 0;
  std::size_t live_faces_ = 0;
};

/// Weight of a distance to a face's middle beside one to its plane: a normal is off by 0.02, about one degree.
constexpr double kMiddleWeight = 4e-4;
/// Weight of a distance to the plane across a border beside one to the plane of a face of the same extent.
constexpr double kBorderWeight = 10.0;

/// A collapse on offer. It is void once either end has moved since.
struct Offer {
  double cost;
  std::int32_t a, b;
  std::uint32_t moves;  ///< of both ends together

  /// std::priority_queue puts the greatest on top; of equally dear ones the lowest vertices come first.
  bool operator<(const Offer& other) const { return std::tie(other.cost, other.a, other.b) < std::tie(cost, a, b); }
};

class Simplifier {
 public:
  /// @param edges of these faces @pre no face names a vertex twice
  Simplifier(const std::vector<Eigen::Vector3d>& positions, const std::vector<Triangle>& faces, const MeshEdges& edges)
      : mesh_(positions, faces, edges), quadrics_(positions.size()), moves_(positions.size(), 0) {
    for (std::size_t f = 0; f < faces.size(); ++f) add_face(positions, edges, faces[f], f);
  }

  bool run(std::size_t target_faces) {
    // A collapse that the checks refused may have become possible by what happened around it.
    while (mesh_.live_faces() > target_faces) {
      const std::size_t before = mesh_.live_faces();
      offer_all();
      while (mesh_.live_faces() > target_faces && !offers_.empty()) take_offer();
      if (mesh_.live_faces() == before) return false;
    }
    return true;
  }

  const CollapsibleMesh& mesh() const { return mesh_; }

  Mesh result(const Eigen::Vector3d& center) const {
    std::vector<Eigen::Vector3f> vertices;
    vertices.reserve(mesh_.vertex_count());
    for (std::size_t v = 0; v < mesh_.vertex_count(); ++v)
      vertices.emplace_back((mesh_.position(static_cast<std::int32_t>(v)) + center).cast<float>());
    FaceMarks live(mesh_.faces().size());
    for (std::size_t f = 0; f < live.size(); ++f) live[f] = mesh_.is_live(f);
    return chosen_faces(vertices, mesh_.faces(), live);
  }

 private:
  void add_face(const std::vector<Eigen::Vector3d>& positions, const MeshEdges& edges, const Triangle& face,
                std::size_t index) {
    const Eigen::Vector3d &a = positions[at(face[0])], &b = positions[at(face[1])], &c = positions[at(face[2])];
    const Eigen::Vector3d cross = (b - a).cross(c - a);
    const double area = 0.5 * cross.norm();
    if (!(area > 0.0)) return;
    const Eigen::Vector3d normal = cross / (2.0 * area);
    const Quadric quadric = Quadric::plane(normal, a, area) + Quadric::point((a + b + c) / 3.0, kMiddleWeight * area);
    for (const std::int32_t vertex : face) quadrics_[at(vertex)] += quadric;
    for (std::size_t side = 0; side < 3; ++side) {
      const std::int32_t edge = edges.of_face(index, side);
      if (edge < 0 || edges.faces(at(edge)).size() != 1) continue;
      const std::int32_t from = face[side], to = face[(side + 1) % 3];
      const Eigen::Vector3d along = positions[at(to)] - positions[at(from)];
      const Quadric across =
          Quadric::plane(along.cross(normal).normalized(), positions[at(from)], kBorderWeight * along.squaredNorm());
      quadrics_[at(from)] += across;
      quadrics_[at(to)] += across;
    }
  }

  Quadric joint_quadric(std::int32_t a, std::int32_t b) const { return quadrics_[at(a)] + quadrics_[at(b)]; }

  /// The least of the quadric, or the edge's middle where rounding has made it useless.
  Eigen::Vector3d target(std::int32_t a, std::int32_t b) const {
    const Eigen::Vector3d best = joint_quadric(a, b).minimum();
    const Eigen::Vector3d middle = 0.5 * (mesh_.position(a) + mesh_.position(b));
    const double length = (mesh_.position(a) - mesh_.position(b)).norm();
    return (best - middle).norm() <= 2.0 * length ? best : middle;
  }

  void offer(std::int32_t a, std::int32_t b) {
    if (mesh_.is_locked(a) || mesh_.is_locked(b)) return;
    if (a > b) std::swap(a, b);
    offers_.push({joint_quadric(a, b)(target(a, b)), a, b, moves_[at(a)] + moves_[at(b)]});
  }

  void offer_all() {
    for (std::size_t v = 0; v < mesh_.vertex_count(); ++v) {
      const auto vertex = static_cast<std::int32_t>(v);
      for (const std::int32_t other : mesh_.neighbours(vertex)) {
        if (other > vertex) offer(vertex, other);
      }
    }
  }

  void take_offer() {
    const Offer best = offers_.top();
    offers_.pop();
    // Moves only grow, so the sum tells whether either end has moved or is gone.
    if (best.moves != moves_[at(best.a)] + moves_[at(best.b)]) return;
    if (!mesh_.collapse(best.a, best.b, target(best.a, best.b))) return;
    quadrics_[at(best.a)] += quadrics_[at(best.b)];
    ++moves_[at(best.a)];
    ++moves_[at(best.b)];
    for (const std::int32_t other : mesh_.neighbours(best.a)) offer(best.a, other);
  }

  CollapsibleMesh mesh_;
  std::vector<Quadric> quadrics_;
  std::vector<std::uint32_t> moves_;
  std::priority_queue<Offer> offers_;
};

/// In double and around the origin, where quadrics lose least to rounding.
std::vector<Eigen::Vector3d> centred(const std::vector<Eigen::Vector3f>& vertices, const Eigen::Vector3d& center) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite())
      throw InputError("", "vertices[" + std::to_string(v) + "]", "the position is not finite");
    positions.emplace_back(vertices[v].cast<double>() - center);
  }
  return positions;
}

}  // namespace

std::size_t reduced_face_count(std::size_t faces, double reduction) {
  if (!(reduction >= 0.0 && reduction < 1.0)) throw InputError("", "reduction", "must be at least 0 and below 1");
  const auto left = static_cast<std::size_t>(std::llround(static_cast<double>(faces) * (1.0 - reduction)));
  return std::max<std::size_t>(1, left);
}

Simplified simplify(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                    std::size_t target_faces) {
  if (target_faces == 0) throw InputError("", "target_faces", "must be at least 1");
  const Box box = bounding_box(vertices);
  const Eigen::Vector3d center = box.empty() ? Eigen::Vector3d::Zero() : box.center();
  const std::vector<Triangle> proper = proper_faces(faces);
  Simplifier simplifier(centred(vertices, center), proper, MeshEdges(proper, vertices.size()));
  Simplified result;
  result.faces_before = faces.size();
  result.reached = simplifier.run(target_faces);
  for (std::size_t v = 0; v < vertices.size(); ++v)
    result.locked += simplifier.mesh().is_locked(static_cast<std::int32_t>(v));
  result.mesh = simplifier.result(center);
  return result;
}

}  // namespace anigen::geometry
