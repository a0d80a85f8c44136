#include "anigen/geometry/uv_atlas/chart_splitting.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/uv_atlas/texel_centres.h"

namespace anigen::geometry {
namespace {

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
