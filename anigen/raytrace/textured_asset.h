#pragma once
#include "anigen/asset/asset.h"
#include "anigen/geometry/texture_baking.h"

namespace anigen::raytrace {

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
/// asset had (the exporter makes it metallic 0, roughness 1, as published: reference flows-and-pipeline.md, 5.10 and
/// 5.11), without vertex colours, which would be multiplied with it. Name, skeleton and animations stay.
/// @param asset simplified mesh with its skin; without normals it gets those of its faces' areas
/// @param colored the dense mesh in the same frame, with linear vertex colours
/// @throws InputError as make_uv_atlas and bake_texture, and when there is not one skin row per vertex or none at all
TexturedAsset textured_asset(const Asset& asset, const Mesh& colored, const TextureOptions& options = {});

}  // namespace anigen::raytrace
