#include "anigen/geometry/uv_atlas/uv_atlas.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/embree.h"
#include "anigen/geometry/uv_atlas/chart_mask.h"
#include "anigen/geometry/uv_atlas/chart_packing.h"
#include "anigen/geometry/uv_atlas/chart_splitting.h"
#include "anigen/geometry/uv_atlas/face_adjacency.h"
#include "anigen/geometry/uv_atlas/planar_chart.h"
#include "anigen/geometry/uv_atlas/surface_charts.h"

namespace anigen::geometry {
namespace {

constexpr double kGoodOccupancy = 0.6;  ///< below it, cutting charts is worth the seams
constexpr double kLongChart = 0.4;      ///< of the texture's side: what makes packing hard
constexpr int kMostCuts = 3;
constexpr double kFiner = 4.0;           ///< an overlap a quarter of a texel wide counts
constexpr double kFinestSide = 16384.0;  ///< where that would take too long

void require_within(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError(
      "", option,
      "must be between " + std::to_string(static_cast<int>(low)) + " and " + std::to_string(static_cast<int>(high)));
}

class AtlasBuilder {
 public:
  AtlasBuilder(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
               const UvAtlasOptions& options)
      : vertices_(vertices), faces_(faces), options_(options), surface_(vertices, faces), adjacency_(vertices, faces) {}

  UvAtlas run() {
    std::vector<PlanarChart> charts =
        flattened(surface_charts(surface_, adjacency_, options_.max_deviation * kPi / 180.0));
    if (!(total_area(charts) > 0.0)) throw InputError("", "mesh.faces", "no face has an area");
    charts = flattened(split_overlaps(charts));
    ChartPacking packing = pack_charts(charts, options_.size, options_.gutter);
    for (int i = 0; i < kMostCuts && packing.occupancy < kGoodOccupancy; ++i) {
      std::vector<PlanarChart> cut = flattened(cut_long_charts(charts, packing.texels_per_unit));
      if (cut.size() == charts.size()) break;
      ChartPacking repacked = pack_charts(cut, options_.size, options_.gutter);
      if (repacked.occupancy <= packing.occupancy) break;
      charts = std::move(cut);
      packing = std::move(repacked);
    }
    return assembled(charts, packing);
  }

 private:
  static double total_area(const std::vector<PlanarChart>& charts) {
    double area = 0.0;
    for (const PlanarChart& chart : charts) area += chart.area;
    return area;
  }

  std::vector<PlanarChart> flattened(std::vector<SurfaceChart> charts) const {
    std::vector<PlanarChart> flat(charts.size());
    parallel_for(charts.size(),
                 [&](std::size_t c) { flat[c] = planar_chart(std::move(charts[c]), vertices_, faces_); });
    return flat;
  }

  std::vector<SurfaceChart> split_overlaps(const std::vector<PlanarChart>& charts) const {
    // Finer than the texture would be if the charts filled it: its own centres may fall where these do not.
    const double side = std::min(kFiner * options_.size, std::max(kFinestSide, 1.0 * options_.size));
    const double texels_per_unit = side / std::sqrt(total_area(charts));
    std::vector<std::vector<SurfaceChart>> parts(charts.size());
    parallel_for(charts.size(), [&](std::size_t c) {
      parts[c] = without_overlaps(charts[c], adjacency_, texels_per_unit, 2.0 * side * side);
    });
    std::vector<SurfaceChart> all;
    for (std::vector<SurfaceChart>& part : parts) std::move(part.begin(), part.end(), std::back_inserter(all));
    return all;
  }

  std::vector<SurfaceChart> cut_long_charts(const std::vector<PlanarChart>& charts, double texels_per_unit) const {
    std::vector<SurfaceChart> parts;
    for (const PlanarChart& flat : charts) {
      if (flat.extent.x() * texels_per_unit <= kLongChart * options_.size) {
        parts.push_back(flat.chart);
        continue;
      }
      for (SurfaceChart& part : cut_in_half(flat, adjacency_)) parts.push_back(std::move(part));
    }
    return parts;
  }

  UvAtlas assembled(const std::vector<PlanarChart>& charts, const ChartPacking& packing) const {
    UvAtlas atlas;
    atlas.size = options_.size;
    atlas.texels_per_unit = packing.texels_per_unit;
    atlas.occupancy = packing.occupancy;
    atlas.faces.resize(faces_.size());
    atlas.face_charts.resize(faces_.size());
    double least_cosine = 1.0;
    for (std::size_t c = 0; c < charts.size(); ++c) {
      const PlanarChart& flat = charts[c];
      const auto first = static_cast<std::int32_t>(atlas.vertices.size());
      add_vertices(flat, packing.texels_per_unit, packing.places[c], atlas);
      for (std::size_t i = 0; i < flat.triangles.size(); ++i) {
        const std::int32_t face = flat.chart.faces[i];
        for (std::size_t k = 0; k < 3; ++k) atlas.faces[at(face)][k] = first + flat.triangles[i][k];
        atlas.face_charts[at(face)] = static_cast<std::int32_t>(c);
        if (surface_.areas[at(face)] > 0.0) {
          least_cosine = std::min(least_cosine, surface_.normals[at(face)].dot(flat.chart.axis));
        }
      }
    }
    atlas.stretch = 1.0 / least_cosine;
    return atlas;
  }

  /// The chart's vertices and its plane. Planes of charts have their origin below, textures above.
  void add_vertices(const PlanarChart& flat, double texels_per_unit, const ChartPlace& place, UvAtlas& atlas) const {
    for (std::size_t i = 0; i < flat.points.size(); ++i) {
      const Eigen::Vector2d texel =
          texel_place(flat, flat.points[i], texels_per_unit, place.turns) + Eigen::Vector2d(place.x, place.y);
      const Eigen::Vector2d uv = texel / options_.size;
      atlas.vertices.push_back(flat.vertices[i]);
      atlas.uvs.emplace_back(static_cast<float>(uv.x()), static_cast<float>(1.0 - uv.y()));
    }
    const auto direction = [&](const Eigen::Vector2d& step) {
      const Eigen::Vector2d turned_back = quarter_turned(step, 4 - place.turns) / texels_per_unit;
      return Eigen::Vector3d(turned_back.x() * flat.right + turned_back.y() * flat.up);
    };
    atlas.charts.push_back({direction(Eigen::Vector2d::UnitX()), direction(-Eigen::Vector2d::UnitY())});
  }

  const std::vector<Eigen::Vector3f>& vertices_;
  const std::vector<Triangle>& faces_;
  const UvAtlasOptions& options_;
  SurfaceFaces surface_;
  FaceAdjacency adjacency_;
};

}  // namespace

UvAtlas make_uv_atlas(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const UvAtlasOptions& options) {
  require_within("size", options.size, 16, 8192);
  require_within("gutter", options.gutter, 1, std::min(64, options.size / 4));
  require_within("max_deviation", options.max_deviation, 1, 80);
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface to unwrap");
  check_mesh(vertices, faces);
  return AtlasBuilder(vertices, faces, options).run();
}

}  // namespace anigen::geometry
