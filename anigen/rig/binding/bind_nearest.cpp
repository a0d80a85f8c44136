#include "anigen/rig/binding/bind_nearest.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/geometry/bone_segments.h"
#include "anigen/rig/binding/moving_bones.h"

namespace anigen::rig {

SkinWeights bind_to_nearest_bone(const Mesh& mesh, const Skeleton& skeleton) {
  require_joints(skeleton);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (mesh.vertices[v].allFinite()) continue;
    throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
  }
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& joint : skeleton.positions()) joints.push_back(joint.cast<float>());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  SkinWeights skin;
  for (const std::size_t joint : geometry::nearest_moving_joints(mesh.vertices, segments)) {
    skin.append_row({{static_cast<std::int32_t>(joint), 1.0F}});
  }
  return skin;
}

}  // namespace anigen::rig
