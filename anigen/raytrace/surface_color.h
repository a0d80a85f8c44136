#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "anigen/raytrace/picture.h"
#include "anigen/raytrace/texture.h"

namespace anigen::raytrace {

/// Where a hit lies in the mesh's textures; the mesh must have uvs.
Eigen::Vector2f texture_coordinates(const Mesh& mesh, const Hit& hit);

/// What colour the surface has before light, for every picture mode: set up once per picture.
class SurfaceColor {
 public:
  /// @throws InputError as render()
  SurfaceColor(const Scene& scene, const PictureOptions& options);

  /// Linear RGB; for kNormals the encoded normal, which is not a colour in linear light.
  Eigen::Vector3f at(const Hit& hit) const;

  /// The base colour texture of a material (-1: none); nullptr where it has none or the mesh has no uvs. Only with
  /// kColor.
  const Texture* texture(std::int32_t material) const;

 private:
  Eigen::Vector3f base_color(const Hit& hit) const;

  const Asset* asset_;
  PictureMode mode_;
  std::vector<Eigen::Vector3f> vertex_colors_;      ///< kWeights, sRGB
  std::vector<std::unique_ptr<Texture>> textures_;  ///< one per image; null where no face uses it
};

}  // namespace anigen::raytrace
