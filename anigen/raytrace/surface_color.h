#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "anigen/raytrace/picture.h"
#include "anigen/raytrace/texture.h"

namespace anigen::raytrace {

/// What colour the surface has before light, for every picture mode: set up once per picture.
class SurfaceColor {
 public:
  /// @throws InputError as render()
  SurfaceColor(const Scene& scene, const PictureOptions& options);

  /// Linear RGB; for kNormals the encoded normal, which is not a colour in linear light.
  Eigen::Vector3f at(const Hit& hit) const;

 private:
  Eigen::Vector3f base_color(const Hit& hit) const;

  const Asset* asset_;
  PictureMode mode_;
  std::vector<Eigen::Vector3f> vertex_colors_;      ///< kWeights, sRGB
  std::vector<std::unique_ptr<Texture>> textures_;  ///< one per image; null where no face uses it
};

}  // namespace anigen::raytrace
