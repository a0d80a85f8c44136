#include "anigen/prepare/creatures/creature.h"

#include <algorithm>
#include <cmath>

#include "anigen/asset/normalize.h"
#include "anigen/core/error.h"
#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/paint.h"
#include "anigen/prepare/creatures/rig.h"
#include "anigen/prepare/creatures/surface.h"
#include "anigen/prepare/creatures/weights.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;

struct Family {
  const char* name;
  void (*build)(Body&);
};

constexpr Family kFamilies[] = {
    {"biped", build_biped}, {"quadruped", build_quadruped}, {"bird", build_bird},           {"fish", build_fish},
    {"snake", build_snake}, {"spider", build_spider},       {"insect", build_insect},       {"dragon", build_dragon},
    {"plant", build_plant}, {"tree", build_tree},           {"robot_arm", build_robot_arm}, {"lamp", build_lamp},
    {"crab", build_crab},   {"octopus", build_octopus},     {"hand", build_hand},
};

constexpr std::size_t kFewestVertices = 2000, kMostVertices = 8000;

/// The surface with a vertex count near the one drawn: surface nets make about 1.5 vertices per spacing² of area.
Surface surface_of(const Body& body, double wanted) {
  double area = 0.0;
  for (const Primitive& p : body.primitives) area += p.carve ? 0.0 : surface_area(p);
  double spacing = std::sqrt(1.5 * 0.7 * area / wanted);
  spacing *= std::sqrt(estimate_vertices(body.primitives, spacing) / wanted);
  Surface best;
  for (int attempt = 0; attempt < 12; ++attempt) {
    Surface surface = extract_surface(body.primitives, spacing, body.machine ? 1 : 2);
    const auto count = static_cast<double>(surface.vertices.size());
    if (count == 0.0) {
      spacing *= 0.97;
      continue;
    }
    best = std::move(surface);
    if (count >= kFewestVertices && count <= kMostVertices) return best;
    spacing *= std::sqrt(count / std::clamp(wanted, 1.2 * kFewestVertices, 0.8 * kMostVertices));
  }
  return best;
}

/// Vertex colours: the paint of the primitive a vertex lies on, evaluated in the plan frame so that a bent limb keeps
/// its stripes.
std::vector<Eigen::Vector4f> colors_of(const Body& body, const Surface& surface, const SkinWeights& skin) {
  std::vector<Eigen::Vector4f> colors;
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) {
    const Vector3d& x = surface.vertices[v];
    const Primitive* best = nullptr;
    double nearest = 1e300;
    for (int i : surface.lists[surface.vertex_lists[v]]) {
      const Primitive& p = body.primitives[i];
      const double d = std::abs(signed_distance(p, x));
      if (d < nearest) {
        nearest = d;
        best = &p;
      }
    }
    Vector3d plan = Vector3d::Zero(), normal = Vector3d::Zero();
    for (std::size_t k = 0; k < skin.row_size(v); ++k) {
      const Influence& influence = skin.row(v)[k];
      const Eigen::Affine3d back = body.joints[influence.joint].posed.inverse(Eigen::Isometry);
      plan += influence.weight * (back * x);
      normal += influence.weight * (back.linear() * surface.normals[v]);
    }
    const Vector3d color = paint_color(body.paints[best->paint], plan, normal.normalized(), best->center, best->look);
    colors.emplace_back(static_cast<float>(color.x()), static_cast<float>(color.y()), static_cast<float>(color.z()),
                        1.0f);
  }
  return colors;
}

SkinWeights renumber(const SkinWeights& skin, const std::vector<int>& position) {
  SkinWeights result;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    std::vector<Influence> row(skin.row(v), skin.row(v) + skin.row_size(v));
    for (Influence& influence : row) influence.joint = position[influence.joint];
    result.append_row(std::move(row));
  }
  return result;
}

Asset assemble(const Family& family, std::uint64_t seed, std::uint64_t index) {
  Body body(Rng(seed, std::string("creature/") + family.name, index));
  family.build(body);
  body.apply_pose();
  const double wanted = std::min(body.resolution * body.rng.uniform(3800.0, 6800.0), 7400.0);
  const Surface surface = surface_of(body, wanted);
  const SkinWeights skin = paint_weights(body, surface);
  const RigStyle style = random_style(body, body.rng);

  Asset asset;
  asset.name = std::string(family.name) + "_" + std::to_string(seed) + "_" + std::to_string(index);
  for (const Vector3d& x : surface.vertices) asset.mesh.vertices.push_back(x.cast<float>());
  for (const Vector3d& n : surface.normals) asset.mesh.normals.push_back(n.cast<float>());
  asset.mesh.faces = surface.faces;
  asset.mesh.colors = colors_of(body, surface, skin);
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  asset.skeleton = make_skeleton(body, style);
  asset.skin = renumber(skin, style.position);
  Material material;
  material.name = "default";
  material.double_sided = false;
  asset.materials.push_back(material);
  asset.animations.push_back(make_idle_animation(body, asset.skeleton, style, body.rng));
  normalize(asset);
  return asset;
}

}  // namespace

const std::vector<std::string>& creature_families() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (const Family& family : kFamilies) result.emplace_back(family.name);
    return result;
  }();
  return names;
}

const std::string& creature_family(std::uint64_t seed, std::uint64_t index) {
  return creature_families()[Rng(seed, "creature family", index).index(creature_families().size())];
}

Asset make_creature(std::uint64_t seed, std::uint64_t index) {
  return make_creature(creature_family(seed, index), seed, index);
}

Asset make_creature(const std::string& family, std::uint64_t seed, std::uint64_t index) {
  std::string known;
  for (const Family& candidate : kFamilies) {
    if (family == candidate.name) return assemble(candidate, seed, index);
    known += (known.empty() ? "" : ", ") + std::string(candidate.name);
  }
  throw InputError("", "creature family", "there is no family \"" + family + "\"; known are " + known);
}

}  // namespace anigen::prepare
