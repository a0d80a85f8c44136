#include "anigen/raytrace/cutout.h"

#include <algorithm>
#include <array>

namespace anigen::raytrace {
namespace {

constexpr int kMostLayers = 1024;    ///< of holes behind each other; more ends the ray
constexpr double kStep = 4e-6;       ///< relative; how far behind a hole a ray goes on: above Embree's rounding
constexpr double kSmallStep = 1e-9;  ///< the same where the hole is at the ray's very start

/// Where a face is sampled to judge a material: near its corners and in the middle.
const std::array<Eigen::Vector3f, 4> kProbes = {Eigen::Vector3f(1.0f / 3, 1.0f / 3, 1.0f / 3),
                                                Eigen::Vector3f(0.8f, 0.1f, 0.1f), Eigen::Vector3f(0.1f, 0.8f, 0.1f),
                                                Eigen::Vector3f(0.1f, 0.1f, 0.8f)};

double area(const Scene& scene, const Triangle& face) {
  const auto corner = [&](std::size_t k) { return scene.vertices()[static_cast<std::size_t>(face[k])].cast<double>(); };
  const Eigen::Vector3d a = corner(0), b = corner(1), c = corner(2);
  return 0.5 * Eigen::Vector3d(b - a).cross(Eigen::Vector3d(c - a)).norm();
}

}  // namespace

Cutout::Cutout(const Scene& scene, const SurfaceColor& colors, float cutoff)
    : scene_(&scene), colors_(&colors), cutoff_(cutoff) {
  const Asset& asset = scene.asset();
  const std::vector<std::int32_t>& materials = asset.mesh.face_materials;
  std::vector<double> whole(asset.materials.size(), 0.0), hole(asset.materials.size(), 0.0);
  for (std::size_t f = 0; f < materials.size(); ++f) {
    const Texture* texture = colors.texture(materials[f]);
    if (texture == nullptr || texture->opaque()) continue;
    const double share = area(scene, asset.mesh.faces[f]) / static_cast<double>(kProbes.size());
    Hit hit;
    hit.face = static_cast<std::int32_t>(f);
    const auto material = static_cast<std::size_t>(materials[f]);
    for (const Eigen::Vector3f& probe : kProbes) {
      hit.barycentric = probe;
      whole[material] += share;
      if (texture->alpha(texture_coordinates(asset.mesh, hit)) < cutoff) hole[material] += share;
    }
  }
  std::vector<bool> holes(asset.materials.size());
  for (std::size_t m = 0; m < holes.size(); ++m) holes[m] = hole[m] <= kLargestHole * whole[m] && whole[m] > 0.0;
  if (cutoff > 0.0f && std::find(holes.begin(), holes.end(), true) != holes.end()) holes_ = std::move(holes);
}

bool Cutout::passes(const Hit& hit) const {
  if (holes_.empty()) return false;
  const Mesh& mesh = scene_->asset().mesh;
  const std::int32_t material = mesh.face_materials[static_cast<std::size_t>(hit.face)];
  if (material < 0 || !holes_[static_cast<std::size_t>(material)]) return false;
  return colors_->texture(material)->alpha(texture_coordinates(mesh, hit)) < cutoff_;
}

Hit Cutout::behind_holes(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, Hit hit) const {
  for (int layer = 0; hit.face >= 0 && passes(hit); ++layer) {
    if (layer == kMostLayers) return {};
    hit = scene_->trace(origin, direction, hit.distance * (1.0 + kStep) + kSmallStep);
  }
  return hit;
}

bool Cutout::occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const {
  const Eigen::Vector3d from = origin.cast<double>(), along = direction.cast<double>();
  const Hit hit = behind_holes(from, along, scene_->trace(from, along, scene_->epsilon()));
  return hit.face >= 0 && hit.distance < distance;
}

}  // namespace anigen::raytrace
