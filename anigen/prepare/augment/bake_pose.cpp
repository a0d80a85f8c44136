#include "anigen/prepare/augment/bake_pose.h"

#include <Eigen/SVD>
#include <array>
#include <cstring>
#include <unordered_map>
#include <utility>

#include "anigen/core/random.h"
#include "anigen/raytrace/posed_normals.h"

namespace anigen::prepare {
namespace {

// Bytes of what makes two vertices the same place of one smooth surface: position and normal before, position after.
using PlaceKey = std::array<float, 9>;

struct PlaceHash {
  std::size_t operator()(const PlaceKey& key) const {
    return static_cast<std::size_t>(
        stable_hash({reinterpret_cast<const char*>(key.data()), key.size() * sizeof(float)}));
  }
};

// Vertices are split where texture coordinates jump. Seen alone, the two sides of such a seam turn differently, and the
// seam would show; so they are joined first. Hard edges, whose normals differ, stay apart.
std::vector<Eigen::Vector3f> turned_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& posed) {
  std::unordered_map<PlaceKey, std::int32_t, PlaceHash> places;
  std::vector<std::int32_t> place_of(mesh.vertices.size());
  Mesh joined;
  std::vector<Eigen::Vector3f> joined_posed;
  for (std::size_t v = 0; v < place_of.size(); ++v) {
    PlaceKey key;
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<std::size_t>(i);
      // + 0 makes -0 and 0 the same bytes.
      key[at] = mesh.vertices[v][i] + 0.0f;
      key[at + 3] = mesh.normals[v][i] + 0.0f;
      key[at + 6] = posed[v][i] + 0.0f;
    }
    const auto [entry, is_new] = places.emplace(key, static_cast<std::int32_t>(joined.vertices.size()));
    if (is_new) {
      joined.vertices.push_back(mesh.vertices[v]);
      joined.normals.push_back(mesh.normals[v]);
      joined_posed.push_back(posed[v]);
    }
    place_of[v] = entry->second;
  }
  for (Triangle face : mesh.faces) {
    for (std::int32_t& corner : face) corner = place_of[static_cast<std::size_t>(corner)];
    joined.faces.push_back(face);
  }
  const std::vector<Eigen::Vector3f> turned = raytrace::posed_normals(joined, joined_posed);
  std::vector<Eigen::Vector3f> normals(place_of.size());
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const Eigen::Vector3f& normal = turned[static_cast<std::size_t>(place_of[v])];
    const float length = normal.norm();
    normals[v] = length > 1e-6f ? Eigen::Vector3f(normal / length) : mesh.normals[v];
  }
  return normals;
}

bool same(const std::vector<Eigen::Matrix4d>& a, const std::vector<Eigen::Matrix4d>& b) {
  for (std::size_t j = 0; j < a.size(); ++j) {
    const Eigen::Matrix4d difference = (a[j] - b[j]).cwiseAbs();
    const double size = a[j].topLeftCorner<3, 3>().cwiseAbs().maxCoeff();
    if (difference.topRightCorner<3, 1>().maxCoeff() > 1e-6) return false;
    if (difference.topLeftCorner<3, 3>().maxCoeff() > 1e-5 * size) return false;
  }
  return true;
}

}  // namespace

std::optional<std::size_t> collapsed_joint(const std::vector<Eigen::Matrix4d>& world) {
  for (std::size_t j = 0; j < world.size(); ++j) {
    if (!world[j].allFinite()) return j;
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(world[j].topLeftCorner<3, 3>());
    const Eigen::Vector3d stretches = svd.singularValues();
    if (!(stretches[2] > 1e-9 * stretches[0]) || !(stretches[0] > 1e-30)) return j;
  }
  return std::nullopt;
}

Asset bake_pose(const Asset& asset, const std::vector<Eigen::Matrix4d>& world, std::vector<Eigen::Vector3f> vertices) {
  Asset baked;
  baked.name = asset.name;
  baked.mesh = asset.mesh;
  if (!asset.mesh.normals.empty()) baked.mesh.normals = turned_normals(asset.mesh, vertices);
  baked.mesh.vertices = std::move(vertices);
  baked.skin = asset.skin;
  baked.materials = asset.materials;
  baked.images = asset.images;
  Skeleton& skeleton = baked.skeleton;
  skeleton.names = asset.skeleton.names;
  skeleton.parents = asset.skeleton.parents;
  skeleton.bind = world;
  skeleton.rest = bind_pose(skeleton);
  if (same(skeleton.bind, forward_kinematics(skeleton.parents, skeleton.rest))) return baked;
  for (Eigen::Matrix4d& frame : skeleton.bind) {
    frame.topLeftCorner<3, 3>() = decompose(frame).rotation.toRotationMatrix();
  }
  skeleton.rest = bind_pose(skeleton);
  return baked;
}

}  // namespace anigen::prepare
