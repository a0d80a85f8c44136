#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace anigen::io::gltf_import {

/// Nearest of a fixed set of points, by a balanced kd-tree.
class NearestPoint {
 public:
  explicit NearestPoint(std::vector<Eigen::Vector3f> points);
  /// @return index into the points given @pre there is at least one
  std::size_t operator()(const Eigen::Vector3f& query) const;

 private:
  void build(std::size_t first, std::size_t last, int axis);
  void search(std::size_t first, std::size_t last, int axis, const Eigen::Vector3f& query, std::size_t& best,
              float& distance) const;

  std::vector<Eigen::Vector3f> points_;
  std::vector<std::size_t> order_;  // the root of a range is its middle; halves left and right of it
};

}  // namespace anigen::io::gltf_import
