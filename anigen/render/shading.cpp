#include "anigen/render/shading.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::render {

namespace {

constexpr float kTwoPi = 6.2831853f;
constexpr float kFloorDarkness = 0.45f;

float fraction(float value) { return value - std::floor(value); }

/// Two unit vectors that complete `normal` to a frame (Duff et al. 2017).
void tangents(const Eigen::Vector3f& normal, Eigen::Vector3f& first, Eigen::Vector3f& second) {
  const float sign = std::copysign(1.0f, normal.z());
  const float a = -1.0f / (sign + normal.z()), b = normal.x() * normal.y() * a;
  first = {1.0f + sign * normal.x() * normal.x() * a, sign * b, -sign * normal.x()};
  second = {b, sign + normal.y() * normal.y() * a, -normal.y()};
}

Eigen::Vector3f cosine_direction(const Eigen::Vector3f& normal, const Eigen::Vector2f& at) {
  Eigen::Vector3f first, second;
  tangents(normal, first, second);
  const float radius = std::sqrt(at.x()), angle = kTwoPi * at.y();
  return radius * std::cos(angle) * first + radius * std::sin(angle) * second +
         std::sqrt(std::max(0.0f, 1.0f - at.x())) * normal;
}

std::uint32_t scramble(std::uint32_t value) {
  value ^= value >> 16;
  value *= 0x7FEB352Du;
  value ^= value >> 15;
  value *= 0x846CA68Bu;
  return value ^ (value >> 16);
}

constexpr int kMostLayers = 1024;    ///< of holes behind each other; more ends the ray
constexpr double kStep = 4e-6;       ///< relative; how far behind a hole a ray goes on: above Embree's rounding
constexpr double kSmallStep = 1e-9;  ///< the same where the hole is at the ray's very start

/// Sample points of a face to judge a material: near its corners and in the middle.
const std::array<Eigen::Vector3f, 4> kProbes = {Eigen::Vector3f(1.0f / 3, 1.0f / 3, 1.0f / 3),
                                                Eigen::Vector3f(0.8f, 0.1f, 0.1f), Eigen::Vector3f(0.1f, 0.8f, 0.1f),
                                                Eigen::Vector3f(0.1f, 0.1f, 0.8f)};

double area(const Scene& scene, const Triangle& face) { return 0.5 * area_vector(scene.vertices(), face).norm(); }

}  // namespace

PixelSequence::PixelSequence(int x, int y, int skip) : index_(static_cast<std::uint32_t>(skip)) {
  const std::uint32_t hash = scramble(static_cast<std::uint32_t>(x) + scramble(static_cast<std::uint32_t>(y) + 1u));
  shift_x_ = static_cast<float>(hash & 0xFFFFu) / 65536.0f;
  shift_y_ = static_cast<float>(hash >> 16) / 65536.0f;
}

Eigen::Vector2f PixelSequence::next() {
  const auto i = static_cast<float>(index_++);
  return {fraction(shift_x_ + 0.75487767f * i), fraction(shift_y_ + 0.56984029f * i)};
}

LightRig studio_lights(const Camera& camera) {
  const Eigen::Vector3f up = Eigen::Vector3f::UnitZ(), right = camera.right.cast<float>();
  const Eigen::Vector3f back = -up.cross(right);  // towards the viewer, level
  LightRig rig;
  rig.key_direction = (-0.55f * right + 0.95f * up + 0.75f * back).normalized();
  rig.fill_direction = (0.80f * right + 0.15f * up + 0.55f * back).normalized();
  rig.key = 0.80f;
  rig.fill = 0.16f;
  rig.above = 0.42f;
  rig.below = 0.24f;
  rig.key_radius = 0.10f;
  return rig;
}

LightRig dataset_lights() {
  LightRig rig;
  rig.key_direction = Eigen::Vector3f(4.0f, 1.0f, 6.0f).normalized();
  rig.fill_direction = Eigen::Vector3f(-4.0f, -3.0f, 1.0f).normalized();
  rig.key = 0.60f;
  rig.fill = 0.16f;
  rig.above = 0.45f;
  rig.below = 0.14f;
  rig.key_radius = 0.05f;
  return rig;
}

Studio::Studio(const Scene& scene, const LightRig& rig, int occlusion_rays, bool shadows, const Cutout* holes)
    : scene_(&scene),
      holes_(holes != nullptr && holes->empty() ? nullptr : holes),
      rig_(rig),
      reach_(static_cast<float>(scene.box().diagonal())),
      occlusion_rays_(occlusion_rays),
      shadows_(shadows) {}

bool Studio::blocked(const Eigen::Vector3f& point, const Eigen::Vector3f& direction, float distance) const {
  const bool something = scene_->occluded(point, direction, distance);
  return something && holes_ != nullptr ? holes_->occluded(point, direction, distance) : something;
}

float Studio::key_visible(const Eigen::Vector3f& point, PixelSequence& sequence) const {
  Eigen::Vector3f first, second;
  tangents(rig_.key_direction, first, second);
  const Eigen::Vector2f at = sequence.next();
  const float radius = rig_.key_radius * std::sqrt(at.x()), angle = kTwoPi * at.y();
  const Eigen::Vector3f direction =
      (rig_.key_direction + radius * std::cos(angle) * first + radius * std::sin(angle) * second).normalized();
  return blocked(point, direction, 2.0f * reach_) ? 0.0f : 1.0f;
}

float Studio::openness(const Eigen::Vector3f& point, const Eigen::Vector3f& normal, int rays,
                       PixelSequence& sequence) const {
  int open = 0;
  for (int i = 0; i < rays; ++i) {
    if (!blocked(point, cosine_direction(normal, sequence.next()), 0.3f * reach_)) ++open;
  }
  return static_cast<float>(open) / static_cast<float>(rays);
}

float Studio::light(const Hit& hit, PixelSequence& sequence) const {
  const Eigen::Vector3f& normal = hit.normal;
  const float above = 0.5f + 0.5f * normal.z();
  float ambient = rig_.below + (rig_.above - rig_.below) * above;
  float key = std::max(0.0f, normal.dot(rig_.key_direction));
  const float fill = std::max(0.0f, normal.dot(rig_.fill_direction));
  if (occlusion_rays_ > 0 || (shadows_ && key > 0.0f)) {
    const Eigen::Vector3f point = scene_->shadow_origin(hit);
    if (occlusion_rays_ > 0) ambient *= openness(point, normal, occlusion_rays_, sequence);
    if (shadows_ && key > 0.0f) key *= key_visible(point, sequence);
  }
  return ambient + rig_.key * key + rig_.fill * fill;
}

float Studio::floor_shadow(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                           PixelSequence& sequence) const {
  const Box& box = scene_->box();
  if (box.empty() || direction.z() > -1e-6 || origin.z() <= box.low.z()) return 0.0f;
  const Eigen::Vector3d at = origin + (box.low.z() - origin.z()) / direction.z() * direction;
  const double away = (at - box.center()).head<2>().norm() / std::max(box.diagonal(), 1e-300);
  if (away > 1.5) return 0.0f;
  const Eigen::Vector3f point = at.cast<float>();
  const float key = 1.0f - key_visible(point, sequence);
  const float contact = 1.0f - openness(point, Eigen::Vector3f::UnitZ(), 2, sequence);
  const auto fade = static_cast<float>(std::clamp(3.0 - 2.0 * away, 0.0, 1.0));
  return fade * kFloorDarkness * std::min(1.0f, 0.65f * key + 0.7f * contact);
}

Cutout::Cutout(const Scene& scene, const SurfaceColor& colors, float cutoff) : scene_(&scene), colors_(&colors) {
  const Asset& asset = scene.asset();
  if (cutoff <= 0.0f) return;
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
  std::vector<float> cutoffs(asset.materials.size(), 0.0f);
  for (std::size_t m = 0; m < cutoffs.size(); ++m) {
    const Material& material = asset.materials[m];
    if (whole[m] == 0.0 || material.alpha_mode == AlphaMode::kOpaque) continue;
    if (material.alpha_mode == AlphaMode::kMask) {
      cutoffs[m] = material.alpha_cutoff / std::max(material.base_color.w(), 1e-6f);
    } else if (hole[m] <= kLargestHole * whole[m]) {
      cutoffs[m] = cutoff;
    }
  }
  if (std::any_of(cutoffs.begin(), cutoffs.end(), [](float c) { return c > 0.0f; })) cutoffs_ = std::move(cutoffs);
}

bool Cutout::passes(const Hit& hit) const {
  if (cutoffs_.empty()) return false;
  const Mesh& mesh = scene_->asset().mesh;
  const std::int32_t material = mesh.face_materials[at(hit.face)];
  if (material < 0 || cutoffs_[at(material)] <= 0.0f) return false;
  return colors_->texture(material)->alpha(texture_coordinates(mesh, hit)) < cutoffs_[at(material)];
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

}  // namespace anigen::render
