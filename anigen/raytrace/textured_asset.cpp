#include "anigen/raytrace/textured_asset.h"

#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/image.h"
#include "anigen/raytrace/srgb.h"

namespace anigen::raytrace {
namespace {

io::Image srgb_image(const geometry::LinearTexture& texture) {
  io::Image image(texture.size, texture.size);
  for (std::size_t i = 0; i < texture.texels.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const float value = linear_to_srgb(texture.texels[i][static_cast<Eigen::Index>(k)]);
      image.rgba[4 * i + k] = static_cast<std::uint8_t>(std::lround(255.0F * value));
    }
  }
  return image;
}

Mesh split_mesh(const Mesh& mesh, const geometry::UvAtlas& atlas) {
  const std::vector<Eigen::Vector3f> normals =
      mesh.normals.empty() ? vertex_normals(mesh.vertices, mesh.faces) : mesh.normals;
  Mesh split;
  for (const std::int32_t vertex : atlas.vertices) {
    split.vertices.push_back(mesh.vertices[at(vertex)]);
    split.normals.push_back(normals[at(vertex)]);
  }
  split.faces = atlas.faces;
  split.uvs = atlas.uvs;
  split.face_materials.assign(split.faces.size(), 0);
  return split;
}

SkinWeights split_skin(const SkinWeights& skin, const std::vector<std::int32_t>& vertices) {
  SkinWeights split;
  for (const std::int32_t vertex : vertices) {
    const Influence* row = skin.row(at(vertex));
    split.influences.insert(split.influences.end(), row, row + skin.row_size(at(vertex)));
    split.offsets.push_back(split.influences.size());
  }
  return split;
}

void require_matching_rows(const Asset& asset) {
  const std::size_t vertices = asset.mesh.vertices.size(), rows = asset.skin.rows();
  if (!asset.mesh.normals.empty() && asset.mesh.normals.size() != vertices) {
    throw InputError(asset.name, "mesh.normals",
                     std::to_string(asset.mesh.normals.size()) + " for " + std::to_string(vertices) + " vertices");
  }
  if (rows != 0 && rows != vertices) {
    throw InputError(asset.name, "skin", std::to_string(rows) + " rows for " + std::to_string(vertices) + " vertices");
  }
}

}  // namespace

TexturedAsset textured_asset(const Asset& asset, const Mesh& colored, const TextureOptions& options) {
  require_matching_rows(asset);
  const geometry::UvAtlas atlas = geometry::make_uv_atlas(asset.mesh.vertices, asset.mesh.faces, options.atlas);
  const geometry::LinearTexture texture = geometry::bake_texture(atlas, asset.mesh.vertices, colored, options.baking);
  TexturedAsset result;
  result.asset.name = asset.name;
  result.asset.mesh = split_mesh(asset.mesh, atlas);
  result.asset.skeleton = asset.skeleton;
  if (asset.skin.rows() != 0) result.asset.skin = split_skin(asset.skin, atlas.vertices);
  result.asset.animations = asset.animations;
  Material material;
  material.name = "baked";
  material.image = 0;
  result.asset.materials.push_back(std::move(material));
  result.asset.images.push_back({"base_color", "image/png", io::encode_png(srgb_image(texture))});
  result.occupancy = atlas.occupancy;
  result.stretch = atlas.stretch;
  result.charts = atlas.charts.size();
  return result;
}

}  // namespace anigen::raytrace
