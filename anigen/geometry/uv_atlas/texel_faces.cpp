#include "anigen/geometry/uv_atlas/texel_faces.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/uv_atlas/texel_centres.h"

namespace anigen::geometry {
namespace {

const float kTexelDiagonal = std::sqrt(2.0F);

using TexelCorners = std::array<Eigen::Vector3d, 3>;

TexelCorners corners_of(const UvAtlas& atlas, std::size_t face) {
  const Triangle& t = atlas.faces[face];
  return {texel_corner(atlas, t, 0), texel_corner(atlas, t, 1), texel_corner(atlas, t, 2)};
}

/// Calls visit(texel, distance) for the texels around a triangle whose centres are less than a diagonal away.
template <typename Wanted, typename Visit>
void for_each_texel_beside(const TexelCorners& corners, int size, Wanted&& wanted, Visit&& visit) {
  const Eigen::Vector3d low = corners[0].cwiseMin(corners[1]).cwiseMin(corners[2]);
  const Eigen::Vector3d high = corners[0].cwiseMax(corners[1]).cwiseMax(corners[2]);
  const auto texel_at = [&](double value) { return std::clamp(static_cast<int>(std::floor(value)), 0, size - 1); };
  for (int y = texel_at(low.y() - 2.0); y <= texel_at(high.y() + 2.0); ++y) {
    for (int x = texel_at(low.x() - 2.0); x <= texel_at(high.x() + 2.0); ++x) {
      const std::size_t texel = at(y) * at(size) + at(x);
      if (!wanted(texel)) continue;
      const Eigen::Vector3d centre(x + 0.5, y + 0.5, 0.0);
      const auto distance =
          static_cast<float>(nearest_on_triangle(centre, corners[0], corners[1], corners[2]).distance);
      if (distance < kTexelDiagonal) visit(texel, distance);
    }
  }
}

}  // namespace

std::vector<std::int32_t> texel_faces(const UvAtlas& atlas) {
  const std::size_t texels = at(atlas.size) * at(atlas.size);
  std::vector<std::int32_t> shown(texels, -1);
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    const TexelCorners corners = corners_of(atlas, f);
    for_each_texel_centre(corners[0].head<2>(), corners[1].head<2>(), corners[2].head<2>(), atlas.size, atlas.size,
                          [&](int x, int y) {
                            std::int32_t& face = shown[at(y) * at(atlas.size) + at(x)];
                            if (face < 0) face = static_cast<std::int32_t>(f);
                          });
  }
  // Distance of what is beside; 0 inside, where nothing can be nearer.
  std::vector<float> distances(texels);
  for (std::size_t t = 0; t < texels; ++t) distances[t] = shown[t] < 0 ? kTexelDiagonal : 0.0F;
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    for_each_texel_beside(
        corners_of(atlas, f), atlas.size, [&](std::size_t texel) { return distances[texel] > 0.0F; },
        [&](std::size_t texel, float distance) {
          if (distance >= distances[texel]) return;
          distances[texel] = distance;
          shown[texel] = static_cast<std::int32_t>(f);
        });
  }
  return shown;
}

}  // namespace anigen::geometry
