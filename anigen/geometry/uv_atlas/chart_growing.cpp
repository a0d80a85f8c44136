#include "anigen/geometry/uv_atlas/chart_growing.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>
#include <queue>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr int kRelaxations = 3;  ///< borders hardly move afterwards
constexpr std::int32_t kNoChart = -1;

/// A face that a chart could take next; the one that turns least from the chart's axis comes first.
struct ChartCandidate {
  double turn;  ///< 1 - cosine
  std::int32_t face, chart;
  bool operator<(const ChartCandidate& other) const {  // the queue's top is its largest element
    return std::tie(turn, face, chart) > std::tie(other.turn, other.face, other.chart);
  }
};

class ChartGrowing {
 public:
  ChartGrowing(const SurfaceFaces& surface, const FaceAdjacency& adjacency, double least_cosine)
      : surface_(surface), adjacency_(adjacency), least_cosine_(least_cosine), chart_of_(surface.size(), kNoChart) {
    by_area_.resize(surface.size());
    std::iota(by_area_.begin(), by_area_.end(), 0);
    std::stable_sort(by_area_.begin(), by_area_.end(),
                     [&](std::int32_t a, std::int32_t b) { return surface.areas[at(a)] > surface.areas[at(b)]; });
  }

  std::vector<std::vector<std::int32_t>> run() {
    grow_rest();
    for (int i = 0; i < kRelaxations; ++i) relax();
    // Axes move while charts grow: what then turns too far is grown anew, each time among fewer faces.
    while (drop_misfits()) grow_rest();
    std::vector<std::vector<std::int32_t>> connected;
    for (std::vector<std::int32_t>& group : groups()) {
      for (std::vector<std::int32_t>& piece : adjacency_.connected_pieces(std::move(group))) {
        add_fitting(std::move(piece), connected);
      }
    }
    return connected;
  }

 private:
  double turn(std::int32_t face, const Eigen::Vector3d& axis) const {
    return surface_.areas[at(face)] > 0.0 ? 1.0 - surface_.normals[at(face)].dot(axis) : 0.0;
  }

  void offer_neighbours(std::int32_t face, std::int32_t chart, const Eigen::Vector3d& axis,
                        std::priority_queue<ChartCandidate>& queue) const {
    for (const FaceAdjacency::Link& link : adjacency_.of(face)) {
      if (chart_of_[at(link.face)] == kNoChart) queue.push({turn(link.face, axis), link.face, chart});
    }
  }

  /// One chart after another, each around the mean normal of what it has so far.
  void grow_rest() {
    for (const std::int32_t seed : by_area_) {
      if (chart_of_[at(seed)] != kNoChart) continue;
      const std::int32_t chart = charts_++;
      std::priority_queue<ChartCandidate> queue;
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      queue.push({0.0, seed, chart});
      while (!queue.empty()) {
        const std::int32_t face = queue.top().face;
        queue.pop();
        const double length = sum.norm();
        const Eigen::Vector3d axis = length > 0.0 ? Eigen::Vector3d(sum / length) : surface_.normals[at(face)];
        if (chart_of_[at(face)] != kNoChart || !face_fits(surface_, face, axis, least_cosine_)) continue;
        chart_of_[at(face)] = chart;
        sum += surface_.areas[at(face)] * surface_.normals[at(face)];
        offer_neighbours(face, chart, sum.normalized(), queue);
      }
    }
  }

  /// All charts at once from their middles, around the axes that they had; what none can take starts new ones.
  void relax() {
    const std::vector<std::vector<std::int32_t>> before = groups();
    std::fill(chart_of_.begin(), chart_of_.end(), kNoChart);
    charts_ = static_cast<std::int32_t>(before.size());
    std::vector<Eigen::Vector3d> axes;
    std::priority_queue<ChartCandidate> queue;
    for (std::size_t c = 0; c < before.size(); ++c) {
      axes.push_back(mean_normal(surface_, before[c]));
      const std::int32_t middle = middle_face(before[c], axes[c]);
      if (middle >= 0) queue.push({0.0, middle, static_cast<std::int32_t>(c)});
    }
    while (!queue.empty()) {
      const ChartCandidate next = queue.top();
      queue.pop();
      const Eigen::Vector3d& axis = axes[at(next.chart)];
      if (chart_of_[at(next.face)] != kNoChart || !face_fits(surface_, next.face, axis, least_cosine_)) continue;
      chart_of_[at(next.face)] = next.chart;
      offer_neighbours(next.face, next.chart, axis, queue);
    }
    grow_rest();
  }

  /// The face nearest to the area's centre among those that fit; -1 without one.
  std::int32_t middle_face(const std::vector<std::int32_t>& faces, const Eigen::Vector3d& axis) const {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double area = 0.0;
    for (const std::int32_t face : faces) {
      centre += surface_.areas[at(face)] * surface_.centroids[at(face)];
      area += surface_.areas[at(face)];
    }
    if (!(area > 0.0)) return -1;
    centre /= area;
    std::int32_t middle = -1;
    double nearest = std::numeric_limits<double>::infinity();
    for (const std::int32_t face : faces) {
      const double squared = (surface_.centroids[at(face)] - centre).squaredNorm();
      if (squared >= nearest || !face_fits(surface_, face, axis, least_cosine_)) continue;
      nearest = squared;
      middle = face;
    }
    return middle;
  }

  /// Takes faces that turn too far from their chart's mean normal out of it. @return whether there were any
  bool drop_misfits() {
    bool dropped = false;
    for (const std::vector<std::int32_t>& group : groups()) {
      std::vector<std::int32_t> kept = fitting_part(group);
      if (kept.size() == group.size()) continue;
      dropped = true;
      const std::int32_t chart = chart_of_[at(group.front())];
      for (const std::int32_t face : group) chart_of_[at(face)] = kNoChart;
      for (const std::int32_t face : kept) chart_of_[at(face)] = chart;
    }
    return dropped;
  }

  /// The faces that stay when misfits leave until none is left: at least the largest one.
  std::vector<std::int32_t> fitting_part(std::vector<std::int32_t> faces) const {
    while (true) {
      const Eigen::Vector3d axis = mean_normal(surface_, faces);
      std::vector<std::int32_t> kept;
      for (const std::int32_t face : faces) {
        if (face_fits(surface_, face, axis, least_cosine_)) kept.push_back(face);
      }
      if (kept.size() == faces.size()) return kept;
      const bool has_area =
          std::any_of(kept.begin(), kept.end(), [&](int face) { return surface_.areas[at(face)] > 0.0; });
      if (!has_area) {
        return {*std::max_element(faces.begin(), faces.end(), [&](std::int32_t a, std::int32_t b) {
          return surface_.areas[at(a)] < surface_.areas[at(b)];
        })};
      }
      faces = std::move(kept);
    }
  }

  /// A piece of a chart has a mean normal of its own, which its faces must fit, too.
  void add_fitting(std::vector<std::int32_t> piece, std::vector<std::vector<std::int32_t>>& groups) const {
    std::vector<std::int32_t> kept = fitting_part(piece), rest;
    std::set_difference(piece.begin(), piece.end(), kept.begin(), kept.end(), std::back_inserter(rest));
    if (rest.empty()) {
      groups.push_back(std::move(piece));
      return;
    }
    for (auto* part : {&kept, &rest}) {
      for (std::vector<std::int32_t>& smaller : adjacency_.connected_pieces(std::move(*part))) {
        add_fitting(std::move(smaller), groups);
      }
    }
  }

  /// Faces by chart, ascending, without the empty ones.
  std::vector<std::vector<std::int32_t>> groups() const {
    std::vector<std::vector<std::int32_t>> by_chart(at(charts_));
    for (std::size_t f = 0; f < chart_of_.size(); ++f) {
      if (chart_of_[f] != kNoChart) by_chart[at(chart_of_[f])].push_back(static_cast<std::int32_t>(f));
    }
    by_chart.erase(std::remove_if(by_chart.begin(), by_chart.end(), [](const auto& faces) { return faces.empty(); }),
                   by_chart.end());
    return by_chart;
  }

  const SurfaceFaces& surface_;
  const FaceAdjacency& adjacency_;
  double least_cosine_;
  std::vector<std::int32_t> chart_of_;  ///< per face
  std::vector<std::int32_t> by_area_;   ///< faces, largest first
  std::int32_t charts_ = 0;
};

}  // namespace

std::vector<std::vector<std::int32_t>> grow_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                   double least_cosine) {
  return ChartGrowing(surface, adjacency, least_cosine).run();
}

}  // namespace anigen::geometry
