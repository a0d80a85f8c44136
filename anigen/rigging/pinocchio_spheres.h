#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/rigging/pinocchio_solid.h"

namespace anigen::rigging {

struct Sphere {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0.0;
};

/// Points of the medial surface of a solid with their distance to its boundary (docs/reference/riggers.md, 2, step 2):
/// where the directions away from the nearest boundary points of two neighbouring cells are at a right angle or more.
/// Taken between the cells, where both boundary points are equally far, so closer than the grid is fine. Sheets are
/// medial themselves.
/// @param least_radius smaller ones are left out, except on sheets
/// @return largest first, those of equal radius from below to above
std::vector<Sphere> medial_samples(const SolidField& field, double least_radius);

/// A greedy packing (stage 3): in order, those whose centre lies in none that was taken before.
/// @param most ends the packing
std::vector<Sphere> packed_spheres(const std::vector<Sphere>& samples, std::size_t most);

/// Distance to the nearest sample at every cell of the field's grid, to be used with interpolate().
std::vector<float> distance_to_medial(const SolidField& field, const std::vector<Sphere>& samples);

/// Packed spheres and the ways between them inside a solid (docs/reference/riggers.md, 2, step 4), with all shortest
/// paths, by length. Takes 6 bytes per pair of spheres.
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

}  // namespace anigen::rigging
