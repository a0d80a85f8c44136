#include "anigen/geometry/uv_atlas/chart_merging.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/uv_atlas/packing.h"

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

/// The texels of one chart's box, and which have been claimed.
class ChartTexels {
 public:
  ChartTexels(const PlanarChart& flat, double texels_per_unit, double most_texels) : flat_(flat) {
    const double texels = flat.extent.prod() * texels_per_unit * texels_per_unit;
    scale_ = texels_per_unit * std::min(1.0, std::sqrt(most_texels / std::max(texels, 1.0)));
    width_ = texel_count(flat.extent.x());
    height_ = texel_count(flat.extent.y());
    claimed_.resize(at(width_) * at(height_));
    clear();
  }

  void clear() { std::fill(claimed_.begin(), claimed_.end(), false); }

  /// Claims the texels of a triangle. @return whether any had been claimed already
  bool claim_again(std::size_t triangle) {
    bool again = false;
    visit(triangle, [&](std::size_t texel) {
      again = again || claimed_[texel];
      claimed_[texel] = true;
    });
    return again;
  }

  /// Claims the texels of a triangle unless one has been claimed already. @return whether it did
  bool claim(std::size_t triangle) {
    bool free = true;
    visit(triangle, [&](std::size_t texel) { free = free && !claimed_[texel]; });
    if (free) visit(triangle, [&](std::size_t texel) { claimed_[texel] = true; });
    return free;
  }

 private:
  int texel_count(double length) const {
    // A chart without width has a huge length left over at most: the box is bounded, its sides are not.
    return static_cast<int>(std::clamp(std::ceil(length * scale_), 1.0, 65536.0));
  }

  template <typename Visit>
  void visit(std::size_t triangle, Visit&& texel) const {
    const Triangle& t = flat_.triangles[triangle];
    for_each_texel_centre(scale_ * flat_.points[at(t[0])], scale_ * flat_.points[at(t[1])],
                          scale_ * flat_.points[at(t[2])], width_, height_,
                          [&](int x, int y) { texel(at(y) * at(width_) + at(x)); });
  }

  const PlanarChart& flat_;
  double scale_ = 1.0;
  int width_ = 1, height_ = 1;
  std::vector<bool> claimed_;
};

/// Faces of the chart that one part takes: from the first face left outwards, as long as they keep clear of each other.
/// @param rest numbers within the chart; those taken are removed
std::vector<std::int32_t> take_part(const PlanarChart& flat, const FaceAdjacency& adjacency, ChartTexels& texels,
                                    std::vector<std::size_t>& rest) {
  const std::vector<std::int32_t>& faces = flat.chart.faces;
  std::vector<char> open(faces.size(), 0);
  for (const std::size_t triangle : rest) open[triangle] = 1;
  std::vector<std::int32_t> part;
  texels.clear();
  std::vector<std::size_t> queue = {rest.front()};
  open[rest.front()] = 0;
  for (std::size_t next = 0; next < queue.size(); ++next) {
    if (!texels.claim(queue[next])) continue;
    part.push_back(faces[queue[next]]);
    for (const FaceAdjacency::Link& link : adjacency.of(part.back())) {
      const auto found = std::lower_bound(faces.begin(), faces.end(), link.face);
      if (found == faces.end() || *found != link.face) continue;
      const auto neighbour = static_cast<std::size_t>(found - faces.begin());
      if (open[neighbour] == 0) continue;
      open[neighbour] = 0;
      queue.push_back(neighbour);
    }
  }
  std::sort(part.begin(), part.end());
  rest.erase(std::remove_if(
                 rest.begin(), rest.end(),
                 [&](std::size_t triangle) { return std::binary_search(part.begin(), part.end(), faces[triangle]); }),
             rest.end());
  return part;
}

}  // namespace

std::vector<std::vector<std::int32_t>> merge_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                    double least_cosine,
                                                    std::vector<std::vector<std::int32_t>> groups) {
  return ChartMerging(surface, adjacency, least_cosine, std::move(groups)).run();
}

std::vector<SurfaceChart> without_overlaps(const PlanarChart& flat, const FaceAdjacency& adjacency,
                                           double texels_per_unit, double most_texels) {
  ChartTexels texels(flat, texels_per_unit, most_texels);
  std::vector<std::size_t> rest;
  bool overlaps = false;
  for (std::size_t triangle = 0; triangle < flat.triangles.size(); ++triangle) {
    overlaps = texels.claim_again(triangle) || overlaps;
    rest.push_back(triangle);
  }
  if (!overlaps) return {flat.chart};
  std::vector<SurfaceChart> parts;
  while (!rest.empty()) parts.push_back({take_part(flat, adjacency, texels, rest), flat.chart.axis});
  return parts;
}

std::vector<SurfaceChart> cut_in_half(const PlanarChart& flat, const FaceAdjacency& adjacency) {
  std::vector<std::int32_t> halves[2];
  for (std::size_t i = 0; i < flat.triangles.size(); ++i) {
    double sum = 0.0;
    for (const std::int32_t corner : flat.triangles[i]) sum += flat.points[at(corner)].x();
    halves[sum < 1.5 * flat.extent.x() ? 0 : 1].push_back(flat.chart.faces[i]);
  }
  std::vector<SurfaceChart> parts;
  for (std::vector<std::int32_t>& half : halves) {
    for (std::vector<std::int32_t>& piece : adjacency.connected_pieces(std::move(half))) {
      parts.push_back({std::move(piece), flat.chart.axis});
    }
  }
  return parts;
}

}  // namespace anigen::geometry
