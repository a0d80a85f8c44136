#include "anigen/geometry/uv_atlas/charts.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <queue>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {

namespace {

constexpr std::size_t kMostFacesLinkedAtOnce = 8;  ///< pairs grow with the square

struct FaceEdge {
  std::int32_t low, high;  ///< welded vertices
  std::int32_t face;
  double length;
  bool operator<(const FaceEdge& other) const {
    return std::tie(low, high, face) < std::tie(other.low, other.high, other.face);
  }
  bool same_place(const FaceEdge& other) const { return low == other.low && high == other.high; }
};

bool position_before(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::make_tuple(a.x(), a.y(), a.z()) < std::make_tuple(b.x(), b.y(), b.z());
}

/// A number per vertex, the same for vertices at the same position.
std::vector<std::int32_t> welded_vertices(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<std::int32_t> order(vertices.size()), welded(vertices.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::int32_t a, std::int32_t b) { return position_before(vertices[at(a)], vertices[at(b)]); });
  std::int32_t number = -1;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_new = i == 0 || position_before(vertices[at(order[i - 1])], vertices[at(order[i])]);
    welded[at(order[i])] = is_new ? ++number : number;
  }
  return welded;
}

std::vector<FaceEdge> sorted_edges(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  const std::vector<std::int32_t> welded = welded_vertices(vertices);
  std::vector<FaceEdge> edges;
  edges.reserve(3 * faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t from = faces[f][k], to = faces[f][(k + 1) % 3];
      const auto [low, high] = std::minmax(welded[at(from)], welded[at(to)]);
      if (low == high) continue;
      const double length = (vertices[at(to)].cast<double>() - vertices[at(from)].cast<double>()).norm();
      edges.push_back({low, high, static_cast<std::int32_t>(f), length});
    }
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// Calls visit(face, other face, length of the edge) for both directions of every pair.
template <typename Visit>
void for_each_linked_pair(const std::vector<FaceEdge>& edges, Visit&& visit) {
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].same_place(edges[begin])) ++end;
    const std::size_t reach = end - begin <= kMostFacesLinkedAtOnce ? end - begin : 2;
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t k = i + 1; k < std::min(end, i + reach); ++k) {
        if (edges[i].face == edges[k].face) continue;
        visit(edges[i].face, edges[k].face, edges[i].length);
        visit(edges[k].face, edges[i].face, edges[i].length);
      }
    }
  }
}

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

/// The first steps of surface_charts(): groups of faces that grow; each connected, none empty, all within the limit,
/// together every face once.
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
      for (std::vector<std::int32_t>& piece : adjacency_.connected_pieces(std::move(group)))
        add_fitting(std::move(piece), connected);
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
      for (std::vector<std::int32_t>& smaller : adjacency_.connected_pieces(std::move(*part)))
        add_fitting(std::move(smaller), groups);
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

double planar_cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Corners in counter-clockwise order (Andrew's monotone chain); fewer than three when all points are on a line.
std::vector<Eigen::Vector2d> convex_hull(std::vector<Eigen::Vector2d> points) {
  const auto before = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  };
  std::sort(points.begin(), points.end(), before);
  std::vector<Eigen::Vector2d> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t first = hull.size();
    for (const Eigen::Vector2d& point : points) {
      while (hull.size() >= first + 2 &&
             planar_cross(hull.back() - hull[hull.size() - 2], point - hull.back()) <= 0.0) {
        hull.pop_back();
      }
      hull.push_back(point);
    }
    hull.pop_back();  // starts the other side
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

/// Direction of the longer side of the smallest rectangle around the points; it shares a side with their hull.
Eigen::Vector2d longer_side(const std::vector<Eigen::Vector2d>& points) {
  const std::vector<Eigen::Vector2d> hull = convex_hull(points);
  Eigen::Vector2d best = Eigen::Vector2d::UnitX();
  double smallest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Eigen::Vector2d side = hull[(i + 1) % hull.size()] - hull[i];
    if (side.isZero(0.0)) continue;
    const Eigen::Vector2d along = side.normalized(), across(-along.y(), along.x());
    Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const Eigen::Vector2d& corner : hull) {
      const Eigen::Vector2d turned(along.dot(corner), across.dot(corner));
      low = low.cwiseMin(turned);
      high = high.cwiseMax(turned);
    }
    const Eigen::Vector2d extent = high - low;
    if (extent.prod() >= smallest) continue;
    smallest = extent.prod();
    best = extent.x() >= extent.y() ? along : across;
  }
  return best;
}

}  // namespace

FaceAdjacency::FaceAdjacency(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
    : offsets_(faces.size() + 1, 0) {
  const std::vector<FaceEdge> edges = sorted_edges(vertices, faces);
  for_each_linked_pair(edges, [&](std::int32_t face, std::int32_t, double) { ++offsets_[at(face) + 1]; });
  std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
  links_.resize(offsets_.back());
  std::vector<std::size_t> next(offsets_.begin(), offsets_.end() - 1);
  for_each_linked_pair(edges, [&](std::int32_t face, std::int32_t other, double length) {
    links_[next[at(face)]++] = {other, length};
  });
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const auto begin = links_.begin() + static_cast<std::ptrdiff_t>(offsets_[f]);
    const auto end = links_.begin() + static_cast<std::ptrdiff_t>(offsets_[f + 1]);
    std::sort(begin, end,
              [](const Link& a, const Link& b) { return std::tie(a.face, a.length) < std::tie(b.face, b.length); });
  }
}

FaceAdjacency::Links FaceAdjacency::of(std::int32_t face) const {
  return {links_.data() + offsets_[at(face)], links_.data() + offsets_[at(face) + 1]};
}

std::vector<std::vector<std::int32_t>> FaceAdjacency::connected_pieces(std::vector<std::int32_t> faces) const {
  std::sort(faces.begin(), faces.end());
  std::vector<bool> reached(faces.size(), false);
  std::vector<std::vector<std::int32_t>> pieces;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    if (reached[i]) continue;
    reached[i] = true;
    std::vector<std::int32_t> piece = {faces[i]};
    for (std::size_t next = 0; next < piece.size(); ++next) {
      for (const Link& link : of(piece[next])) {
        const auto found = std::lower_bound(faces.begin(), faces.end(), link.face);
        if (found == faces.end() || *found != link.face) continue;
        const auto place = static_cast<std::size_t>(found - faces.begin());
        if (reached[place]) continue;
        reached[place] = true;
        piece.push_back(link.face);
      }
    }
    std::sort(piece.begin(), piece.end());
    pieces.push_back(std::move(piece));
  }
  return pieces;
}

SurfaceFaces::SurfaceFaces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  for (const Triangle& face : faces) {
    areas.push_back(0.5 * area_vector(vertices, face).norm());
    normals.push_back(face_normal(vertices, face));
    const Eigen::Vector3d a = vertices[at(face[0])].cast<double>();
    const Eigen::Vector3d b = vertices[at(face[1])].cast<double>(), c = vertices[at(face[2])].cast<double>();
    centroids.push_back((a + b + c) / 3.0);
  }
}

Eigen::Vector3d mean_normal(const SurfaceFaces& surface, const std::vector<std::int32_t>& faces) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const std::int32_t face : faces) sum += surface.areas[at(face)] * surface.normals[at(face)];
  const double length = sum.norm();
  return length > 0.0 ? Eigen::Vector3d(sum / length) : Eigen::Vector3d::Zero();
}

std::vector<SurfaceChart> surface_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                         double max_deviation) {
  const double least_cosine = std::cos(max_deviation);
  std::vector<SurfaceChart> charts;
  for (std::vector<std::int32_t>& group :
       merge_charts(surface, adjacency, least_cosine, ChartGrowing(surface, adjacency, least_cosine).run())) {
    Eigen::Vector3d axis = mean_normal(surface, group);
    // Nothing but faces without area: any direction will do.
    if (axis.isZero()) axis = Eigen::Vector3d::UnitZ();
    charts.push_back({std::move(group), axis});
  }
  return charts;
}

PlanarChart planar_chart(SurfaceChart chart, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces) {
  PlanarChart flat;
  flat.chart = std::move(chart);
  for (const std::int32_t face : flat.chart.faces)
    flat.vertices.insert(flat.vertices.end(), faces[at(face)].begin(), faces[at(face)].end());
  std::sort(flat.vertices.begin(), flat.vertices.end());
  flat.vertices.erase(std::unique(flat.vertices.begin(), flat.vertices.end()), flat.vertices.end());
  flat.right = flat.chart.axis.unitOrthogonal();
  flat.up = flat.chart.axis.cross(flat.right);
  for (const std::int32_t vertex : flat.vertices) {
    const Eigen::Vector3d p = vertices[at(vertex)].cast<double>();
    flat.points.emplace_back(flat.right.dot(p), flat.up.dot(p));
  }

  const Eigen::Vector2d along = longer_side(flat.points);
  const Eigen::Vector3d right = along.x() * flat.right + along.y() * flat.up;
  flat.up = along.x() * flat.up - along.y() * flat.right;
  flat.right = right;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (Eigen::Vector2d& point : flat.points) {
    point = Eigen::Vector2d(along.dot(point), planar_cross(along, point));
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  for (Eigen::Vector2d& point : flat.points) point -= low;
  flat.extent = high - low;

  for (const std::int32_t face : flat.chart.faces) {
    Triangle triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto found = std::lower_bound(flat.vertices.begin(), flat.vertices.end(), faces[at(face)][k]);
      triangle[k] = static_cast<std::int32_t>(found - flat.vertices.begin());
    }
    flat.triangles.push_back(triangle);
    const Eigen::Vector2d& a = flat.points[at(triangle[0])];
    flat.area += 0.5 * planar_cross(flat.points[at(triangle[1])] - a, flat.points[at(triangle[2])] - a);
  }
  return flat;
}

}  // namespace anigen::geometry
