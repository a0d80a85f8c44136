#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/uv_atlas/chart_growing.h"

namespace anigen::geometry {
namespace {

class ChartMerging {
 public:
  ChartMerging(const SurfaceFaces& surface, const FaceAdjacency& adjacency, double least_cosine,
               std::vector<std::vector<std::int32_t>> groups)
      : surface_(surface),
        adjacency_(adjacency),
        least_cosine_(least_cosine),
        groups_(std::move(groups)),
        chart_of_(surface.size(), -1),
        areas_(groups_.size(), 0.0),
        normals_(groups_.size(), Eigen::Vector3d::Zero()) {
    for (std::size_t c = 0; c < groups_.size(); ++c) {
      for (const std::int32_t face : groups_[c]) {
        chart_of_[at(face)] = static_cast<std::int32_t>(c);
        areas_[c] += surface.areas[at(face)];
        normals_[c] += surface.areas[at(face)] * surface.normals[at(face)];
      }
      waiting_.insert({areas_[c], static_cast<std::int32_t>(c)});
    }
  }

  std::vector<std::vector<std::int32_t>> run() {
    while (!waiting_.empty()) {
      const std::int32_t chart = waiting_.begin()->second;
      waiting_.erase(waiting_.begin());
      for (const std::int32_t neighbour : neighbours(chart)) {
        if (!can_join(chart, neighbour)) continue;
        join(chart, neighbour);
        break;
      }
    }
    std::vector<std::vector<std::int32_t>> merged;
    for (std::vector<std::int32_t>& group : groups_) {
      if (group.empty()) continue;
      std::sort(group.begin(), group.end());
      merged.push_back(std::move(group));
    }
    return merged;
  }

 private:
  /// By length of the common border, longest first.
  std::vector<std::int32_t> neighbours(std::int32_t chart) const {
    std::map<std::int32_t, double> borders;
    for (const std::int32_t face : groups_[at(chart)]) {
      for (const FaceAdjacency::Link& link : adjacency_.of(face)) {
        if (chart_of_[at(link.face)] != chart) borders[chart_of_[at(link.face)]] += link.length;
      }
    }
    std::vector<std::int32_t> order;
    for (const auto& [other, length] : borders) order.push_back(other);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::int32_t a, std::int32_t b) { return borders.at(a) > borders.at(b); });
    return order;
  }

  bool can_join(std::int32_t a, std::int32_t b) const {
    const Eigen::Vector3d sum = normals_[at(a)] + normals_[at(b)];
    const double length = sum.norm();
    if (!(length > 0.0)) return areas_[at(a)] <= 0.0 && areas_[at(b)] <= 0.0;
    const Eigen::Vector3d axis = sum / length;
    for (const std::int32_t chart : {a, b}) {
      for (const std::int32_t face : groups_[at(chart)]) {
        if (!face_fits(surface_, face, axis, least_cosine_)) return false;
      }
    }
    return true;
  }

  void join(std::int32_t from, std::int32_t into) {
    for (const std::int32_t face : groups_[at(from)]) {
      chart_of_[at(face)] = into;
      groups_[at(into)].push_back(face);
    }
    groups_[at(from)].clear();
    waiting_.erase({areas_[at(into)], into});
    areas_[at(into)] += areas_[at(from)];
    normals_[at(into)] += normals_[at(from)];
    // Grown, it may have a chance that it had not before.
    waiting_.insert({areas_[at(into)], into});
  }

  const SurfaceFaces& surface_;
  const FaceAdjacency& adjacency_;
  double least_cosine_;
  std::vector<std::vector<std::int32_t>> groups_;
  std::vector<std::int32_t> chart_of_;
  std::vector<double> areas_;
  std::vector<Eigen::Vector3d> normals_;               ///< sums weighted by area
  std::set<std::pair<double, std::int32_t>> waiting_;  ///< by area
};

}  // namespace

std::vector<std::vector<std::int32_t>> merge_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                    double least_cosine,
                                                    std::vector<std::vector<std::int32_t>> groups) {
  return ChartMerging(surface, adjacency, least_cosine, std::move(groups)).run();
}

}  // namespace anigen::geometry
