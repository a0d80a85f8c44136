#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/geometry/uv_atlas/uv_atlas.h"
#include "anigen/io/image.h"
#include "anigen/render/picture.h"

namespace anigen::render {

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

/// Texture coordinates of a hit; the mesh must have uvs.
Eigen::Vector2f texture_coordinates(const Mesh& mesh, const Hit& hit);

/// Colour of the surface before light, for every picture mode: set up once per picture.
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

struct TextureOptions {
  geometry::UvAtlasOptions atlas;
  geometry::TextureBakingOptions baking;
};

struct TexturedAsset {
  Asset asset;
  double occupancy = 0.0;  ///< as in geometry::UvAtlas
  double stretch = 1.0;    ///< as in geometry::UvAtlas
  std::size_t charts = 0;
};

/// An asset with the colours of a dense mesh as its base colour texture, ready for io::write_gltf: the mesh is
/// unwrapped (geometry::make_uv_atlas) and its vertices split where charts meet, with normals and skin weights of the
/// vertex that they were, so that shading stays smooth across seams and parts move together; colours are baked
/// (geometry::bake_texture) and kept as a PNG in sRGB. One opaque, double-sided material takes the place of what the
/// asset had (the exporter makes it metallic 0, roughness 1, as published: docs/reference/flows.md, 5.8 and 5.9),
/// without vertex colours, which would be multiplied with it. Name, skeleton and animations stay.
/// @param asset simplified mesh with its skin; without normals it gets those of its faces' areas
/// @param colored the dense mesh in the same frame, with linear vertex colours
/// @throws InputError as make_uv_atlas and bake_texture, and when there is not one skin row per vertex or none at all
TexturedAsset textured_asset(const Asset& asset, const Mesh& colored, const TextureOptions& options = {});

}  // namespace anigen::render
