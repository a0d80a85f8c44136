#pragma once
#include <Eigen/Core>
#include <Eigen/LU>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

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
  CollapsibleMesh(std::vector<Eigen::Vector3d> positions, std::vector<Triangle> faces, const MeshEdges& edges);

  std::size_t vertex_count() const { return positions_.size(); }
  std::size_t live_faces() const { return live_faces_; }
  const Eigen::Vector3d& position(std::int32_t vertex) const { return positions_[static_cast<std::size_t>(vertex)]; }
  /// True when an edge of this vertex has one face only.
  bool on_border(std::int32_t vertex) const { return border_[static_cast<std::size_t>(vertex)] != 0; }
  /// Vertices with an edge of more than two faces, which collapse() leaves alone.
  bool is_locked(std::int32_t vertex) const { return locked_[static_cast<std::size_t>(vertex)] != 0; }

  /// Vertices that share an edge with this one, each once, in no particular order; valid until the next call.
  const std::vector<std::int32_t>& neighbours(std::int32_t vertex);

  /// Moves `a` to `target` and makes `b` one with it, unless that changed the topology or turned a face over.
  /// @return whether it was done; `b` then has no faces any more @pre a and b are neighbours
  bool collapse(std::int32_t a, std::int32_t b, const Eigen::Vector3d& target);

  /// All faces there ever were, those that are gone too.
  const std::vector<Triangle>& faces() const { return faces_; }
  bool is_live(std::size_t face) const { return dead_[face] == 0; }

 private:
  static constexpr std::int32_t kNone = -1;

  /// Calls visit(face, corner) for the live faces of a vertex; false from visit ends it. Unlinks dead corners.
  template <typename Visit>
  bool each_corner(std::int32_t vertex, const Visit& visit);
  bool keeps_topology(std::int32_t a, std::int32_t b);
  bool turns_a_face(std::int32_t vertex, std::int32_t other, const Eigen::Vector3d& target);

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

/// Share of faces that the published pipeline takes away (reference flows-and-pipeline.md, 5.8).
inline constexpr double kPublishedReduction = 0.95;

/// Faces that are left of `faces` after that share is taken away, at least 1.
/// @throws InputError unless 0 ≤ reduction < 1
std::size_t reduced_face_count(std::size_t faces, double reduction);

struct Simplified {
  Mesh mesh;  ///< vertices and faces alone; vertices are new, in no relation to the old ones
  std::size_t faces_before = 0;
  bool reached = true;     ///< false: no further edge could go, the mesh has more faces than asked for
  std::size_t locked = 0;  ///< vertices that had to stay, since more than two faces meet at an edge of theirs
};

/// Fewer faces by collapsing edges, the cheapest first, each into the place with the least sum of squared distances to
/// the planes of the faces that went into it (Garland and Heckbert 1997; in place of VTK's decimation in reference
/// flows-and-pipeline.md, 5.8). A small share of the distances counts to the faces' middles in place of their planes,
/// so that flat parts get triangles of good shape (Trettner and Kobbelt 2020, isotropic noise of normals).
///
/// Topology stays: only edges that satisfy the link condition go (Dey et al. 1999), so a closed surface stays closed,
/// no edge gets a third face, and neither parts nor handles vanish. No face turns over. Borders of open surfaces keep
/// their shape by planes across them. Faces that name a vertex twice and vertices without faces are dropped.
/// Deterministic; runs on the calling thread.
/// @throws InputError when a face refers to a missing vertex or a position is not finite, or target_faces is 0
Simplified simplify(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                    std::size_t target_faces);

}  // namespace anigen::geometry
