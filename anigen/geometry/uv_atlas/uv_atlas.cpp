#include "anigen/geometry/uv_atlas/uv_atlas.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/uv_atlas/chart_merging.h"
#include "anigen/geometry/uv_atlas/charts.h"
#include "anigen/geometry/uv_atlas/packing.h"

namespace anigen::geometry {

namespace {

constexpr double kGoodOccupancy = 0.6;  ///< below it, cutting charts is worth the seams
constexpr double kLongChart = 0.4;      ///< of the texture's side: what makes packing hard
constexpr int kMostCuts = 3;
constexpr double kFiner = 4.0;           ///< an overlap a quarter of a texel wide counts
constexpr double kFinestSide = 16384.0;  ///< where that would take too long

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
        if (surface_.areas[at(face)] > 0.0)
          least_cosine = std::min(least_cosine, surface_.normals[at(face)].dot(flat.chart.axis));
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

constexpr int kMostBakedTexels = 8192;
constexpr int kMostSupersampling = 8;
constexpr double kAboutAsNear = 3.0;  ///< times as far as the nearest point, for one that faces the right way

void require_sound_atlas(const UvAtlas& atlas, std::size_t vertices) {
  require_between(atlas.size, 1, kMostBakedTexels, "atlas.size");
  if (!(atlas.texels_per_unit > 0.0)) throw InputError("", "atlas.texels_per_unit", "must be positive");
  if (atlas.uvs.size() != atlas.vertices.size() || atlas.face_charts.size() != atlas.faces.size())
    throw InputError("", "atlas", "its arrays differ in length");
  const auto require = [](bool is_sound, const char* array, std::size_t index) {
    if (!is_sound) {
      throw InputError("", std::string("atlas.") + array + "[" + std::to_string(index) + "]",
                       "out of range: the atlas belongs to another mesh");
    }
  };
  const auto inside = [](std::int32_t index, std::size_t count) { return index >= 0 && at(index) < count; };
  for (std::size_t v = 0; v < atlas.vertices.size(); ++v) {
    require(inside(atlas.vertices[v], vertices), "vertices", v);
    const Eigen::Vector2f& uv = atlas.uvs[v];
    require(uv.minCoeff() >= 0.0F && uv.maxCoeff() <= 1.0F, "uvs", v);
  }
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    for (const std::int32_t corner : atlas.faces[f]) require(inside(corner, atlas.vertices.size()), "faces", f);
    require(inside(atlas.face_charts[f], atlas.charts.size()), "face_charts", f);
  }
}

void require_colors(const Mesh& colored) {
  if (colored.colors.size() != colored.vertices.size() || colored.colors.empty()) {
    throw InputError("", "colored.colors",
                     "a texture is read from vertex colours, but there are " + std::to_string(colored.colors.size()) +
                         " for " + std::to_string(colored.vertices.size()) + " vertices");
  }
  for (std::size_t v = 0; v < colored.colors.size(); ++v) {
    if (!colored.colors[v].head<3>().allFinite())
      throw InputError("", "colored.colors[" + std::to_string(v) + "]", "not finite");
  }
}

/// The colour of the dense mesh at places of the other one.
class ColorSource {
 public:
  ColorSource(const Mesh& colored, double texel) : colored_(colored), surface_(colored), texel_(texel) {
    for (const Triangle& face : colored.faces) facing_.push_back(area_vector(colored.vertices, face));
  }

  /// @param normal of the place, any length @param guess a face near it, replaced by the one found
  Eigen::Vector3f color(const Eigen::Vector3d& point, const Eigen::Vector3d& normal, std::int32_t& guess) const {
    NearestPoint found = surface_.query(point, guess);
    guess = found.at.face;
    if (faces_away(found, normal)) {
      for (const NearestPoint& other : surface_.within(point, kAboutAsNear * found.distance + texel_)) {
        if (faces_away(other, normal)) continue;
        found = other;
        break;
      }
    }
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    const Triangle& face = colored_.faces[at(found.at.face)];
    for (std::size_t k = 0; k < 3; ++k) {
      const auto weight = static_cast<float>(found.at.barycentric[static_cast<Eigen::Index>(k)]);
      sum += weight * colored_.colors[at(face[k])].head<3>();
    }
    return sum;
  }

 private:
  bool faces_away(const NearestPoint& point, const Eigen::Vector3d& normal) const {
    return facing_[at(point.at.face)].dot(normal) < 0.0;
  }

  const Mesh& colored_;
  NearestSurface surface_;
  std::vector<Eigen::Vector3d> facing_;  ///< per face
  double texel_;                         ///< its side on the surface
};

class TextureBaker {
 public:
  TextureBaker(const UvAtlas& atlas, const std::vector<Eigen::Vector3f>& vertices, const Mesh& colored, int samples)
      : atlas_(atlas),
        vertices_(vertices),
        source_(colored, 1.0 / atlas.texels_per_unit),
        shown_(texel_faces(atlas)),
        samples_(samples) {}

  LinearTexture run(const std::function<void(std::size_t, std::size_t)>& progress) const {
    LinearTexture texture;
    texture.size = atlas_.size;
    texture.texels.assign(shown_.size(), Eigen::Vector3f::Zero());
    std::mutex mutex;
    std::size_t done = 0;
    parallel_for(at(atlas_.size), [&](std::size_t row) {
      bake_row(static_cast<int>(row), texture);
      if (!progress) return;
      const std::lock_guard<std::mutex> lock(mutex);
      progress(++done, at(atlas_.size));
    });
    std::vector<char> known(shown_.size());
    std::transform(shown_.begin(), shown_.end(), known.begin(), [](std::int32_t face) { return face >= 0 ? 1 : 0; });
    fill_unknown_texels(texture.size, known, texture.texels);
    return texture;
  }

 private:
  void bake_row(int y, LinearTexture& texture) const {
    std::int32_t guess = -1;
    for (int x = 0; x < atlas_.size; ++x) {
      const std::size_t texel = at(y) * at(atlas_.size) + at(x);
      if (shown_[texel] < 0) continue;
      const auto face = at(shown_[texel]);
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (int i = 0; i < samples_ * samples_; ++i) {
        const double step = 1.0 / samples_;
        const Eigen::Vector3d place(x + (i % samples_ + 0.5) * step, y + (i / samples_ + 0.5) * step, 0.0);
        sum += sample(place, face, guess);
      }
      texture.texels[texel] = sum / static_cast<float>(samples_ * samples_);
    }
  }

  /// @param place in texels; outside the face one goes on along its chart's plane
  Eigen::Vector3f sample(const Eigen::Vector3d& place, std::size_t face, std::int32_t& guess) const {
    const Triangle& t = atlas_.faces[face];
    const NearestPoint on_face =
        nearest_on_triangle(place, texel_corner(atlas_, t, 0), texel_corner(atlas_, t, 1), texel_corner(atlas_, t, 2));
    const Triangle corners = {atlas_.vertices[at(t[0])], atlas_.vertices[at(t[1])], atlas_.vertices[at(t[2])]};
    const Eigen::Vector3d beyond = place - on_face.position;
    const AtlasChart& chart = atlas_.charts[at(atlas_.face_charts[face])];
    Eigen::Vector3d point = beyond.x() * chart.right + beyond.y() * chart.down;
    for (std::size_t k = 0; k < 3; ++k)
      point += on_face.at.barycentric[static_cast<Eigen::Index>(k)] * vertices_[at(corners[k])].cast<double>();
    return source_.color(point, area_vector(vertices_, corners), guess);
  }

  const UvAtlas& atlas_;
  const std::vector<Eigen::Vector3f>& vertices_;
  ColorSource source_;
  std::vector<std::int32_t> shown_;  ///< face per texel
  int samples_;
};

}  // namespace

UvAtlas make_uv_atlas(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const UvAtlasOptions& options) {
  require_between(options.size, 16, 8192, "size");
  require_between(options.gutter, 1, std::min(64, options.size / 4), "gutter");
  require_between(options.max_deviation, 1, 80, "max_deviation");
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface to unwrap");
  check_mesh(vertices, faces);
  return AtlasBuilder(vertices, faces, options).run();
}

LinearTexture bake_texture(const UvAtlas& atlas, const std::vector<Eigen::Vector3f>& vertices, const Mesh& colored,
                           const TextureBakingOptions& options) {
  require_between(options.supersampling, 1, kMostSupersampling, "supersampling");
  require_sound_atlas(atlas, vertices.size());
  require_colors(colored);
  return TextureBaker(atlas, vertices, colored, options.supersampling).run(options.progress);
}

}  // namespace anigen::geometry
