#include "anigen/io/gltf/import_nearest.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace anigen::io::gltf_import {

NearestPoint::NearestPoint(std::vector<Eigen::Vector3f> points) : points_(std::move(points)), order_(points_.size()) {
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  build(0, order_.size(), 0);
}

void NearestPoint::build(std::size_t first, std::size_t last, int axis) {
  if (last - first < 2) return;
  const std::size_t middle = first + (last - first) / 2;
  const auto at = [&](std::size_t i) { return order_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(first), at(middle), at(last), [&](std::size_t a, std::size_t b) {
    return points_[a][axis] != points_[b][axis] ? points_[a][axis] < points_[b][axis] : a < b;
  });
  build(first, middle, (axis + 1) % 3);
  build(middle + 1, last, (axis + 1) % 3);
}

std::size_t NearestPoint::operator()(const Eigen::Vector3f& query) const {
  std::size_t best = order_.front();
  float distance = std::numeric_limits<float>::infinity();
  search(0, order_.size(), 0, query, best, distance);
  return best;
}

void NearestPoint::search(std::size_t first, std::size_t last, int axis, const Eigen::Vector3f& query,
                          std::size_t& best, float& distance) const {
  if (first >= last) return;
  const std::size_t middle = first + (last - first) / 2;
  const std::size_t point = order_[middle];
  const float here = (points_[point] - query).squaredNorm();
  if (here < distance || (here == distance && point < best)) {
    distance = here;
    best = point;
  }
  const float side = query[axis] - points_[point][axis];
  const int next = (axis + 1) % 3;
  const bool left_first = side < 0.0f;
  const std::size_t near_first = left_first ? first : middle + 1, near_last = left_first ? middle : last;
  const std::size_t far_first = left_first ? middle + 1 : first, far_last = left_first ? last : middle;
  search(near_first, near_last, next, query, best, distance);
  if (side * side < distance) search(far_first, far_last, next, query, best, distance);
}

}  // namespace anigen::io::gltf_import
