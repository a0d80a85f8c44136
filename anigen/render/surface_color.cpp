#include "anigen/render/surface_color.h"

#include <array>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/foreign_image.h"
#include "anigen/render/scene.h"

namespace anigen::render {

namespace {

const std::array<float, 256>& linear_table() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = srgb_to_linear(static_cast<float>(i) / 255.0f);
    return values;
  }();
  return table;
}

/// Σ_k barycentric_k · value of corner k.
template <typename Value>
Value interpolated(const Hit& hit, const Triangle& face, const std::vector<Value>& values) {
  Value sum = Value::Zero();
  for (std::size_t k = 0; k < 3; ++k) sum += hit.barycentric[static_cast<Eigen::Index>(k)] * values[at(face[k])];
  return sum;
}

/// Texel coordinate in [0, size) and the fraction towards the next texel.
struct Tap {
  int first, second;
  float fraction;
};

Tap tap(float coordinate, int size) {
  // Reducing first keeps precision and makes any finite coordinate safe.
  const float repeated = coordinate - std::floor(coordinate);
  const float position = repeated * static_cast<float>(size) - 0.5f;
  const float low = std::floor(position);
  const int first = (static_cast<int>(low) + size) % size;
  return {first, (first + 1) % size, position - low};
}

const Eigen::Vector3f kPlain(0.72f, 0.72f, 0.72f);  ///< albedo of a mesh without any colour of its own

void check_weights(const Asset& asset, const SkinWeights& weights) {
  if (weights.offsets.empty() || weights.rows() != asset.mesh.vertices.size()) {
    throw InputError(asset.name, "skin",
                     "a picture of the weights needs one row per vertex, but there are " +
                         std::to_string(weights.offsets.empty() ? 0 : weights.rows()) + " rows for " +
                         std::to_string(asset.mesh.vertices.size()) + " vertices");
  }
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    if (weights.offsets[v] > weights.offsets[v + 1] || weights.offsets[v + 1] > weights.influences.size())
      throw InputError(asset.name, "skin.offsets[" + std::to_string(v + 1) + "]", "the row is out of range");
  }
}

/// A material index that is checked once, so that lookups need not.
void check_materials(const Asset& asset) {
  const std::vector<std::int32_t>& materials = asset.mesh.face_materials;
  for (std::size_t f = 0; f < materials.size(); ++f) {
    if (materials[f] < -1 || materials[f] >= static_cast<std::int64_t>(asset.materials.size())) {
      throw InputError(asset.name, "mesh.face_materials[" + std::to_string(f) + "]",
                       "there is no material " + std::to_string(materials[f]));
    }
  }
  for (std::size_t m = 0; m < asset.materials.size(); ++m) {
    const int image = asset.materials[m].image;
    if (image < -1 || image >= static_cast<std::int64_t>(asset.images.size())) {
      throw InputError(asset.name, "materials[" + std::to_string(m) + "].image",
                       "there is no image " + std::to_string(image));
    }
  }
}

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
  for (const std::int32_t vertex : vertices) split.append_copy(skin, at(vertex));
  return split;
}

void require_matching_rows(const Asset& asset) {
  const std::size_t vertices = asset.mesh.vertices.size(), rows = asset.skin.rows();
  if (!asset.mesh.normals.empty() && asset.mesh.normals.size() != vertices) {
    throw InputError(asset.name, "mesh.normals",
                     std::to_string(asset.mesh.normals.size()) + " for " + std::to_string(vertices) + " vertices");
  }
  if (rows != 0 && rows != vertices)
    throw InputError(asset.name, "skin", std::to_string(rows) + " rows for " + std::to_string(vertices) + " vertices");
}

}  // namespace

Texture::Texture(const EncodedImage& image, const std::string& name_for_errors)
    : image_(io::decode_foreign_image(image.bytes, name_for_errors)) {
  if (image_.width < 1 || image_.height < 1) throw InputError(name_for_errors, "", "the picture has no pixels");
  for (std::size_t i = 3; i < image_.rgba.size() && opaque_; i += 4) opaque_ = image_.rgba[i] == 255;
}

Eigen::Vector3f Texture::lookup(const Eigen::Vector2f& uv) const {
  const Tap x = tap(uv.x(), image_.width), y = tap(uv.y(), image_.height);
  const std::array<float, 256>& linear = linear_table();
  const auto texel = [&](int column, int row) {
    const std::uint8_t* p = image_.pixel(column, row);
    return Eigen::Vector3f(linear[p[0]], linear[p[1]], linear[p[2]]);
  };
  const Eigen::Vector3f top = (1.0f - x.fraction) * texel(x.first, y.first) + x.fraction * texel(x.second, y.first);
  const Eigen::Vector3f bottom =
      (1.0f - x.fraction) * texel(x.first, y.second) + x.fraction * texel(x.second, y.second);
  return (1.0f - y.fraction) * top + y.fraction * bottom;
}

float Texture::alpha(const Eigen::Vector2f& uv) const {
  if (opaque_) return 1.0f;
  const Tap x = tap(uv.x(), image_.width), y = tap(uv.y(), image_.height);
  const auto texel = [&](int column, int row) { return static_cast<float>(image_.pixel(column, row)[3]) / 255.0f; };
  const float top = (1.0f - x.fraction) * texel(x.first, y.first) + x.fraction * texel(x.second, y.first);
  const float bottom = (1.0f - x.fraction) * texel(x.first, y.second) + x.fraction * texel(x.second, y.second);
  return (1.0f - y.fraction) * top + y.fraction * bottom;
}

Eigen::Vector2f texture_coordinates(const Mesh& mesh, const Hit& hit) {
  const Triangle& face = mesh.faces[static_cast<std::size_t>(hit.face)];
  return interpolated(hit, face, mesh.uvs);
}

SurfaceColor::SurfaceColor(const Scene& scene, const PictureOptions& options)
    : asset_(&scene.asset()), mode_(options.mode) {
  if (mode_ == PictureMode::kWeights) {
    const SkinWeights& weights = options.weights ? *options.weights : asset_->skin;
    check_weights(*asset_, weights);
    vertex_colors_ = options.heat_joints.empty() ? weight_colors(weights) : heat_colors(weights, options.heat_joints);
  }
  if (mode_ == PictureMode::kColor) {
    check_materials(*asset_);
    textures_.resize(asset_->images.size());
    if (asset_->mesh.uvs.empty()) return;
    for (const std::int32_t material : asset_->mesh.face_materials) {
      if (material < 0) continue;
      const int image = asset_->materials[static_cast<std::size_t>(material)].image;
      if (image < 0 || textures_[static_cast<std::size_t>(image)]) continue;
      const EncodedImage& encoded = asset_->images[static_cast<std::size_t>(image)];
      textures_[static_cast<std::size_t>(image)] =
          std::make_unique<Texture>(encoded, asset_->name + " image " + std::to_string(image) + " " + encoded.name);
    }
  }
}

Eigen::Vector3f SurfaceColor::at(const Hit& hit) const {
  if (mode_ == PictureMode::kNormals) return 0.5f * (hit.normal + Eigen::Vector3f::Ones());
  if (mode_ == PictureMode::kColor) return base_color(hit);
  const Triangle& face = asset_->mesh.faces[static_cast<std::size_t>(hit.face)];
  const Eigen::Vector3f color = interpolated(hit, face, vertex_colors_);
  return color.cwiseMax(0.0f).cwiseMin(1.0f).unaryExpr([](float value) { return srgb_to_linear(value); });
}

const Texture* SurfaceColor::texture(std::int32_t material) const {
  if (material < 0) return nullptr;
  const int image = asset_->materials[static_cast<std::size_t>(material)].image;
  return image < 0 ? nullptr : textures_[static_cast<std::size_t>(image)].get();
}

Eigen::Vector3f SurfaceColor::base_color(const Hit& hit) const {
  const Mesh& mesh = asset_->mesh;
  const auto index = static_cast<std::size_t>(hit.face);
  const Triangle& face = mesh.faces[index];
  const std::int32_t material = mesh.face_materials.empty() ? -1 : mesh.face_materials[index];
  Eigen::Vector3f color = material < 0 && mesh.colors.empty() ? kPlain : Eigen::Vector3f(Eigen::Vector3f::Ones());
  if (material >= 0) {
    const Material& m = asset_->materials[static_cast<std::size_t>(material)];
    color = m.base_color.head<3>();
    if (const Texture* image = texture(material))
      color = color.cwiseProduct(image->lookup(texture_coordinates(mesh, hit)));
  }
  if (!mesh.colors.empty()) color = color.cwiseProduct(interpolated(hit, face, mesh.colors).head<3>());
  return color.cwiseMax(0.0f);
}

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

}  // namespace anigen::render
