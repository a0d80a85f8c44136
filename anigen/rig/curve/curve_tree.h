#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

namespace anigen::rig {

/// A curve with the thickness of what is around it, as a tree of points.
struct CurveTree {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> radii;                 ///< [points]
  std::vector<std::vector<int>> neighbours;  ///< [points], ascending

  std::size_t size() const { return points.size(); }
  std::size_t degree(int p) const { return neighbours[static_cast<std::size_t>(p)].size(); }
};

/// Curves as one tree. Of every cycle the edge around which the shape is thinnest is left out, and pieces are connected
/// where they are nearest to each other. @pre points are finite
CurveTree curve_tree(const std::vector<Eigen::Vector3d>& points, const std::vector<double>& radii,
                     const std::vector<std::array<int, 2>>& edges);

/// Takes out branches that end, the shortest first, while they reach less far than `radii` times the radius where they
/// leave the rest, or than `length`. A curve without branches stays.
CurveTree without_spurs(CurveTree tree, double radii, double length);

/// Makes one point of branching points that are nearer to each other along the curve than `radii` times the larger of
/// their radii: what is one hip has three legs, not two forks one after the other.
CurveTree with_joined_branches(CurveTree tree, double radii);

}  // namespace anigen::rig
