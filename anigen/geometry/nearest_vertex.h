#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace anigen::geometry {

/// Nearest vertex of a mesh: set up once (a k-d tree), query many times. Exact in double precision; of equally near
/// vertices the lowest index, whatever threads and order of the queries. Queries are thread-safe.
class NearestVertex {
 public:
  /// @throws InputError without vertices, or naming one that is not finite or beyond 1e100
  explicit NearestVertex(const std::vector<Eigen::Vector3f>& vertices);

  /// @param point finite, within 1e100
  std::int32_t query(const Eigen::Vector3d& point) const;
  /// One index per point, in order; runs on all threads. @throws InputError naming a point that is not finite or beyond
  /// 1e100
  std::vector<std::int32_t> query(const std::vector<Eigen::Vector3d>& points) const;

 private:
  /// Vertices [begin, end) of the tree's order; a leaf has no children.
  struct Node {
    std::int32_t begin = 0, end = 0;
    std::int32_t below = -1, above = -1;  ///< children: up to the plane, from the plane
    int axis = 0;
    double plane = 0.0;
  };
  struct Best;
  std::int32_t build(std::int32_t begin, std::int32_t end);
  void search(std::int32_t node, Best& best) const;

  std::vector<Eigen::Vector3d> vertices_;  ///< in the tree's order
  std::vector<std::int32_t> original_;     ///< index of each in the mesh
  std::vector<Node> nodes_;                ///< the root first
};

}  // namespace anigen::geometry
