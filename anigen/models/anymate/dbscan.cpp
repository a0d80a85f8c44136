#include "anigen/models/anymate/dbscan.h"

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/point_cells.h"
#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kNoise = -1;
constexpr double kLeastReach = 1e-9, kMostReach = 1e9, kFarthestPoint = 1e15;
// Cells compare in single precision; what they find is compared again in double.
constexpr double kReachMargin = 1.0 + 1e-5;

class Reach {
 public:
  Reach(const std::vector<Eigen::Vector3f>& rough, std::vector<Eigen::Vector3d> points, double eps)
      : cells_(rough, static_cast<float>(eps * kReachMargin)), points_(std::move(points)), squared_(eps * eps) {}

  /// Indices within reach of a point, itself included.
  std::vector<int> of(std::size_t point) const {
    std::vector<int> found = cells_.within(point);
    const auto beyond = [&](int other) {
      return (points_[static_cast<std::size_t>(other)] - points_[point]).squaredNorm() > squared_;
    };
    found.erase(std::remove_if(found.begin(), found.end(), beyond), found.end());
    return found;
  }

 private:
  geometry::PointCells cells_;
  std::vector<Eigen::Vector3d> points_;
  double squared_;
};

}  // namespace

std::vector<std::int64_t> dbscan_labels(const Tensor& points, const DbscanOptions& options) {
  require(options.eps >= kLeastReach && options.eps <= kMostReach, "eps", "must be from 1e-9 to 1e9");
  require(options.min_samples >= 1, "min_samples", "must be at least 1");
  const std::vector<Eigen::Vector3d> positions = fields::points_of<double>(points, "points");
  std::vector<Eigen::Vector3f> rough;
  rough.reserve(positions.size());
  for (const Eigen::Vector3d& point : positions) {
    const bool usable = (point.array().abs() <= kFarthestPoint).all();  // false for NaN
    require(usable, "points[" + std::to_string(rough.size()) + "]", "is not finite, or beyond 1e15");
    rough.emplace_back(point.cast<float>());
  }
  std::vector<std::int64_t> labels(positions.size(), kNoise);
  if (positions.empty()) return labels;
  const Reach reach(rough, positions, options.eps);
  std::vector<std::uint8_t> is_core(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i) {
    is_core[i] = static_cast<std::int64_t>(reach.of(i).size()) >= options.min_samples ? 1 : 0;
  }
  std::int64_t next = 0;
  std::vector<std::size_t> open;
  for (std::size_t seed = 0; seed < positions.size(); ++seed) {
    if (labels[seed] != kNoise || is_core[seed] == 0) continue;
    labels[seed] = next;
    open.assign(1, seed);
    while (!open.empty()) {
      const std::size_t point = open.back();
      open.pop_back();
      if (is_core[point] == 0) continue;  // a border point reaches no further
      for (const int other : reach.of(point)) {
        const auto neighbour = static_cast<std::size_t>(other);
        if (labels[neighbour] != kNoise) continue;
        labels[neighbour] = next;
        open.push_back(neighbour);
      }
    }
    ++next;
  }
  return labels;
}

Tensor cluster_means(const Tensor& points, const std::vector<std::int64_t>& labels) {
  require_shape(points, {static_cast<std::int64_t>(labels.size()), 3}, "points");
  std::int64_t count = 0;
  for (const std::int64_t label : labels) count = std::max(count, label + 1);
  const Tensor values = points.detach().to(torch::kCPU, torch::kFloat64);
  const Tensor of = torch::tensor(labels, torch::kInt64) + 1;  // row 0 takes the noise
  const Tensor sums = torch::zeros({count + 1, 3}, torch::kFloat64).index_add_(0, of, values);
  const Tensor sizes =
      torch::zeros({count + 1}, torch::kFloat64).index_add_(0, of, torch::ones_like(of, torch::kFloat64));
  return (sums / sizes.unsqueeze(1)).slice(0, 1).to(nn::dtype_of(points));
}

Tensor merged_joints(const Tensor& joints, const DbscanOptions& options) {
  return cluster_means(joints, dbscan_labels(joints, options));
}

}  // namespace anigen::models::anymate
