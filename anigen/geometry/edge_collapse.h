#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/mesh_edges.h"

namespace anigen::geometry {

/// A triangle mesh whose edges can be collapsed one by one, with the checks that keep its topology. For simplify().
class CollapsibleMesh {
 public:
  /// @param edges of these faces @pre no face names a vertex twice
  CollapsibleMesh(std::vector<Eigen::Vector3d> positions, std::vector<Triangle> faces, const MeshEdges& edges);

  std::size_t vertex_count() const { return positions_.size(); }
  std::size_t live_faces() const { return live_faces_; }
  const Eigen::Vector3d& position(std::int32_t vertex) const { return positions_[static_cast<std::size_t>(vertex)]; }
  /// Whether an edge of this vertex has one face only.
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

}  // namespace anigen::geometry
