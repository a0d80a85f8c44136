#include "anigen/raytrace/surface_color.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/raytrace/palette.h"
#include "anigen/raytrace/srgb.h"

namespace anigen::raytrace {
namespace {

const Eigen::Vector3f kPlain(0.72f, 0.72f, 0.72f);  ///< albedo of a mesh without any colour of its own

void check_weights(const Asset& asset, const SkinWeights& weights) {
  if (weights.offsets.empty() || weights.rows() != asset.mesh.vertices.size()) {
    throw InputError(asset.name, "skin",
                     "a picture of the weights needs one row per vertex, but there are " +
                         std::to_string(weights.offsets.empty() ? 0 : weights.rows()) + " rows for " +
                         std::to_string(asset.mesh.vertices.size()) + " vertices");
  }
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    if (weights.offsets[v] > weights.offsets[v + 1] || weights.offsets[v + 1] > weights.influences.size()) {
      throw InputError(asset.name, "skin.offsets[" + std::to_string(v + 1) + "]", "the row is out of range");
    }
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

}  // namespace

Eigen::Vector2f texture_coordinates(const Mesh& mesh, const Hit& hit) {
  const Triangle& face = mesh.faces[static_cast<std::size_t>(hit.face)];
  Eigen::Vector2f uv = Eigen::Vector2f::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    uv += hit.barycentric[static_cast<Eigen::Index>(k)] * mesh.uvs[static_cast<std::size_t>(face[k])];
  }
  return uv;
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
  switch (mode_) {
    case PictureMode::kNormals:
      return 0.5f * (hit.normal + Eigen::Vector3f::Ones());
    case PictureMode::kWeights: {
      const Triangle& face = asset_->mesh.faces[static_cast<std::size_t>(hit.face)];
      Eigen::Vector3f color = Eigen::Vector3f::Zero();
      for (std::size_t k = 0; k < 3; ++k) {
        color += hit.barycentric[static_cast<Eigen::Index>(k)] * vertex_colors_[static_cast<std::size_t>(face[k])];
      }
      return color.cwiseMax(0.0f).cwiseMin(1.0f).unaryExpr([](float value) { return srgb_to_linear(value); });
    }
    case PictureMode::kColor:
      break;
  }
  return base_color(hit);
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
    if (const Texture* image = texture(material)) {
      color = color.cwiseProduct(image->lookup(texture_coordinates(mesh, hit)));
    }
  }
  if (!mesh.colors.empty()) {
    Eigen::Vector3f tint = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      tint += hit.barycentric[static_cast<Eigen::Index>(k)] * mesh.colors[static_cast<std::size_t>(face[k])].head<3>();
    }
    color = color.cwiseProduct(tint);
  }
  return color.cwiseMax(0.0f);
}

}  // namespace anigen::raytrace
