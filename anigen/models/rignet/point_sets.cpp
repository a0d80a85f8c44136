#include "anigen/models/rignet/point_sets.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "anigen/fields/tensor_points.h"
#include "anigen/models/anymate/checks.h"
#include "anigen/models/rignet/mesh_graph.h"

namespace anigen::models::rignet {
namespace {

constexpr std::size_t kNearestCoarse = 3;
constexpr double kLeastSquare = 1e-16;

struct PointList {
  std::vector<Eigen::Vector3d> at;
  std::vector<std::int64_t> starts;
};

PointList listed(const PointSets& sets) {
  PointList list{fields::points_of<double>(sets.positions, "positions"), {}};
  anymate::require_shape(sets.starts, {-1}, "starts");
  const Tensor starts = sets.starts.to(torch::kCPU, torch::kInt64).contiguous();
  const auto* first = starts.data_ptr<std::int64_t>();
  list.starts.assign(first, first + starts.size(0));
  for (std::size_t b = 0; b + 1 < list.starts.size(); ++b) {
    anymate::require(list.starts[b] < list.starts[b + 1], "starts", "name a set without points");
  }
  anymate::require(!list.starts.empty() && list.starts.back() == sets.positions.size(0), "starts",
                   "do not end at the number of points");
  return list;
}

const Eigen::Vector3d& point(const PointList& list, std::int64_t row) { return list.at[static_cast<std::size_t>(row)]; }

std::vector<std::int64_t> farthest_points(const PointList& list, std::int64_t first, std::int64_t last, double ratio) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::int64_t i = first; i < last; ++i) mean += point(list, i) / static_cast<double>(last - first);
  std::vector<double> left;
  for (std::int64_t i = first; i < last; ++i) left.push_back((point(list, i) - mean).squaredNorm());
  const auto wanted = static_cast<std::size_t>(std::ceil(ratio * static_cast<double>(last - first)));
  std::vector<std::int64_t> chosen;
  while (chosen.size() < std::max<std::size_t>(wanted, 1)) {
    const auto best = std::max_element(left.begin(), left.end()) - left.begin();
    const std::int64_t next = first + best;
    if (chosen.empty()) std::fill(left.begin(), left.end(), 1e300);
    chosen.push_back(next);
    for (std::int64_t i = first; i < last; ++i) {
      double& distance = left[static_cast<std::size_t>(i - first)];
      distance = std::min(distance, (point(list, i) - point(list, next)).squaredNorm());
    }
    left[static_cast<std::size_t>(best)] = -1.0;  // points in one place are still taken once each
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

// The rows of a set by distance from a place, with the squares.
std::vector<std::pair<double, std::int64_t>> by_distance(const PointList& list, std::int64_t first, std::int64_t last,
                                                         const Eigen::Vector3d& place) {
  std::vector<std::pair<double, std::int64_t>> found;
  for (std::int64_t i = first; i < last; ++i) found.emplace_back((point(list, i) - place).squaredNorm(), i);
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

Balls gather_balls(const PointSets& points, double ratio, double radius, std::int64_t most) {
  const PointList list = listed(points);
  std::vector<std::int64_t> centres, counts, sources, degrees;
  for (std::size_t b = 0; b + 1 < list.starts.size(); ++b) {
    const std::int64_t first = list.starts[b], last = list.starts[b + 1];
    const std::vector<std::int64_t> chosen = farthest_points(list, first, last, ratio);
    centres.insert(centres.end(), chosen.begin(), chosen.end());
    counts.push_back(static_cast<std::int64_t>(chosen.size()));
    for (const std::int64_t centre : chosen) {
      std::int64_t degree = 0;
      for (const auto& [squared, row] : by_distance(list, first, last, point(list, centre))) {
        if (squared > radius * radius || degree == most) break;
        sources.push_back(row);
        ++degree;
      }
      degrees.push_back(degree);
    }
  }
  const torch::Device device = points.positions.device();
  Balls balls;
  balls.centres.positions = points.positions.index_select(0, torch::tensor(centres, torch::kInt64).to(device));
  balls.centres.starts = starts_of(counts).to(device);
  balls.edges = EdgeSet{starts_of(degrees), torch::tensor(sources, torch::kInt64)}.to(device);
  return balls;
}

Tensor interpolated(const PointSets& coarse, const Tensor& values, const PointSets& fine) {
  anymate::require_shape(values, {coarse.positions.size(0), -1}, "values");
  const PointList from = listed(coarse), to = listed(fine);
  anymate::require(from.starts.size() == to.starts.size(), "starts", "are of other sets");
  const auto rows = static_cast<std::int64_t>(to.at.size()), slots = static_cast<std::int64_t>(kNearestCoarse);
  Tensor index = torch::zeros({rows, slots}, torch::kInt64), share = torch::zeros({rows, slots}, torch::kFloat64);
  auto place = index.accessor<std::int64_t, 2>();
  auto weight = share.accessor<double, 2>();
  for (std::size_t b = 0; b + 1 < to.starts.size(); ++b) {
    for (std::int64_t row = to.starts[b]; row < to.starts[b + 1]; ++row) {
      const auto nearest = by_distance(from, from.starts[b], from.starts[b + 1], point(to, row));
      for (std::size_t k = 0; k < std::min(kNearestCoarse, nearest.size()); ++k) {
        const auto slot = static_cast<std::int64_t>(k);
        place[row][slot] = nearest[k].second;
        weight[row][slot] = 1.0 / (nearest[k].first + kLeastSquare);
      }
    }
  }
  share = (share / share.sum(1, true)).to(values.device(), values.scalar_type());
  const Tensor taken = values.index_select(0, index.flatten().to(values.device())).view({rows, slots, values.size(1)});
  return (taken * share.unsqueeze(2)).sum(1);
}

}  // namespace anigen::models::rignet
