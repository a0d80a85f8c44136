#include "anigen/geometry/skeleton_mesh.h"

#include <cstdint>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitive_meshes.h"

namespace anigen::geometry {
namespace {

constexpr double kJointRadius = 0.02, kBoneRadius = 0.01;  // of the skeleton's size
constexpr double kShortest = 1e-5;
constexpr int kSubdivisions = 2, kSections = 32;

Eigen::Vector4f color(int red, int green, int blue) {
  return {static_cast<float>(red) / 255.0f, static_cast<float>(green) / 255.0f, static_cast<float>(blue) / 255.0f,
          1.0f};
}

void append(SkeletonMesh& skeleton, const Mesh& part, const Eigen::Vector3d& offset, const Eigen::Vector4f& paint,
            int joint) {
  const auto first = static_cast<std::int32_t>(skeleton.mesh.vertices.size());
  for (const Eigen::Vector3f& vertex : part.vertices) {
    skeleton.mesh.vertices.push_back((vertex.cast<double>() + offset).cast<float>());
    skeleton.mesh.colors.push_back(paint);
    skeleton.skin.append_row({{joint, 1.0f}});
  }
  for (const auto& [a, b, c] : part.faces) skeleton.mesh.faces.push_back({a + first, b + first, c + first});
}

void check(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents) {
  if (joints.empty()) throw InputError("", "joints", "there are none");
  if (joints.size() != parents.size()) {
    throw InputError("", "parents",
                     std::to_string(joints.size()) + " joints but " + std::to_string(parents.size()) + " parents");
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].allFinite()) throw InputError("", "joints[" + std::to_string(j) + "]", "the position is not finite");
    if (parents[j] >= -1 && parents[j] < static_cast<int>(joints.size())) continue;
    throw InputError("", "parents[" + std::to_string(j) + "]", "there is no joint " + std::to_string(parents[j]));
  }
}

}  // namespace

SkeletonMesh skeleton_mesh(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents) {
  check(joints, parents);
  Box box;
  for (const Eigen::Vector3d& joint : joints) box.extend(joint);
  const double size = box.diagonal() < kShortest ? 1.0 : box.diagonal();
  SkeletonMesh skeleton;
  const Mesh ball = icosphere(kSubdivisions, kJointRadius * size);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    append(skeleton, ball, joints[j], color(230, 180, 80), static_cast<int>(j));
    const int parent = parents[j];
    if (parent < 0 || (joints[j] - joints[at(parent)]).norm() < kShortest) continue;
    append(skeleton, cone(joints[at(parent)], joints[j], kBoneRadius * size, kSections), Eigen::Vector3d::Zero(),
           color(160, 180, 200), parent);
  }
  return skeleton;
}

Asset skeleton_asset(const Skeleton& skeleton) {
  SkeletonMesh solid = skeleton_mesh(skeleton.positions(), skeleton.parents);
  Asset shown;
  shown.name = "skeleton";
  shown.skeleton = skeleton;
  shown.mesh = std::move(solid.mesh);
  shown.skin = std::move(solid.skin);
  shown.mesh.normals = vertex_normals(shown.mesh.vertices, shown.mesh.faces);
  return shown;
}

}  // namespace anigen::geometry
