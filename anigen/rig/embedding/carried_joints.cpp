#include "anigen/rig/embedding/carried_joints.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

constexpr double kLeastScale = 0.25, kMostScale = 4.0;

/// What turns and scales the template's bone into the embedded one.
Eigen::Matrix3d bone_change(const Eigen::Vector3d& wanted, const Eigen::Vector3d& embedded) {
  if (!(wanted.norm() > 1e-9) || !(embedded.norm() > 1e-9)) return Eigen::Matrix3d::Identity();
  const double scale = std::clamp(embedded.norm() / wanted.norm(), kLeastScale, kMostScale);
  return scale * Eigen::Quaterniond::FromTwoVectors(wanted, embedded).toRotationMatrix();
}

}  // namespace

void place_carried_joints(const TemplateSkeleton& skeleton, std::vector<Eigen::Vector3d>& joints) {
  const auto& wanted = skeleton.joints;
  const auto first = static_cast<std::size_t>(
      std::find_if(wanted.begin(), wanted.end(), [](const TemplateJoint& joint) { return !joint.carried; }) -
      wanted.begin());
  // Subtrees of carried joints share the change of the joint they hang on.
  std::vector<Eigen::Matrix3d> change(wanted.size(), Eigen::Matrix3d::Identity());
  std::vector<char> above(wanted.size(), 0);
  for (int j = wanted[first].parent; j >= 0; j = wanted[at(j)].parent) {
    above[at(j)] = 1;
    joints[at(j)] = joints[first] + wanted[at(j)].position - wanted[first].position;
  }
  for (std::size_t j = 1; j < wanted.size(); ++j) {
    if (above[j] != 0 || j == first) continue;
    const auto parent = at(wanted[j].parent);
    const Eigen::Vector3d bone = wanted[j].position - wanted[parent].position;
    if (wanted[j].carried) {
      change[j] = change[parent];
      joints[j] = joints[parent] + change[parent] * bone;
    } else {
      change[j] = bone_change(bone, joints[j] - joints[parent]);
    }
  }
}

}  // namespace anigen::rig
