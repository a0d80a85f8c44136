#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/io/image.h"

namespace anigen::raytrace {

/// A base colour texture: sRGB texels, looked up bilinearly in linear light, repeating in both directions.
class Texture {
 public:
  /// @throws InputError when the picture cannot be decoded
  Texture(const EncodedImage& image, const std::string& name_for_errors);

  /// Linear RGB. @param uv glTF convention: (0, 0) is the top left corner of the picture, v runs down
  Eigen::Vector3f lookup(const Eigen::Vector2f& uv) const;
  /// Alpha in [0, 1] at the same place.
  float alpha(const Eigen::Vector2f& uv) const;
  bool opaque() const { return opaque_; }  ///< no texel is transparent

 private:
  io::Image image_;
  bool opaque_ = true;
};

}  // namespace anigen::raytrace
