#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/rig/embedding/medial_spheres.h"

namespace anigen::rig {

/// Packed spheres and the ways between them inside a solid (reference anymate-baselines.md, 9.2, stage 4), with all
/// shortest paths, by length. Takes 6 bytes per pair of spheres.
class SphereGraph {
 public:
  /// Two spheres are neighbours when they intersect, or when no third centre lies in the ball between their centres and
  /// the way from one to the other stays half a radius inside. Pieces of the graph that nothing connects get an edge
  /// where they are nearest to each other, so that every vertex can be reached. @pre at most 32,767 spheres
  SphereGraph(const SolidField& field, std::vector<Sphere> spheres);

  std::size_t size() const { return spheres_.size(); }
  const Sphere& operator[](int v) const { return spheres_[static_cast<std::size_t>(v)]; }
  const std::vector<int>& neighbours(int v) const { return neighbours_[static_cast<std::size_t>(v)]; }
  int bridges() const { return bridges_; }  ///< edges that connect pieces

  double distance(int from, int to) const { return static_cast<double>(distance_[pair(from, to)]); }
  /// The vertex before `to` on the shortest path from `from`; -1 for the same vertex.
  int before(int from, int to) const { return before_[pair(from, to)]; }

 private:
  std::size_t pair(int from, int to) const {
    return static_cast<std::size_t>(from) * spheres_.size() + static_cast<std::size_t>(to);
  }
  void connect(const SolidField& field);
  void bridge_pieces();
  void find_paths(int from);

  std::vector<Sphere> spheres_;
  std::vector<std::vector<int>> neighbours_;
  std::vector<float> distance_;
  std::vector<std::int16_t> before_;
  int bridges_ = 0;
};

}  // namespace anigen::rig
