#include "anigen/rig/binding/moving_bones.h"

#include <algorithm>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/bone_segments.h"
#include "anigen/geometry/segment.h"

namespace anigen::rig {

void require_joints(const Skeleton& skeleton) {
  if (skeleton.size() == 0) throw InputError("", "skeleton", "there is no joint to bind to");
  if (skeleton.bind.size() != skeleton.size()) {
    throw InputError(
        "", "skeleton",
        std::to_string(skeleton.bind.size()) + " bind matrices for " + std::to_string(skeleton.size()) + " joints");
  }
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const auto place = [&] { return "skeleton joint " + std::to_string(j); };
    if (!positions[j].allFinite()) throw InputError("", place(), "the position is not finite");
    if (skeleton.parents[j] < -1 || skeleton.parents[j] >= static_cast<int>(j)) {
      throw InputError("", place(), "its parent " + std::to_string(skeleton.parents[j]) + " does not come before it");
    }
  }
}

std::vector<MovingBones> moving_bones(const Skeleton& skeleton, const WeldedSurface& surface) {
  require_joints(skeleton);
  constexpr double kFarthest = 1e6;
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& position : skeleton.positions()) {
    joints.push_back(surface.to_unit(position).cwiseMax(-kFarthest).cwiseMin(kFarthest).cast<float>());
  }
  std::vector<MovingBones> bones(joints.size());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    bones[j].is_tip = true;
    for (const geometry::BoneSegment& segment : segments[j]) {
      bones[j].lines.push_back({segment.start.cast<double>(), segment.end.cast<double>()});
    }
  }
  for (const int parent : skeleton.parents) {
    if (parent >= 0) bones[at(parent)].is_tip = false;
  }
  return bones;
}

void join_lines(std::vector<MovingBones>& bones) {
  for (MovingBones& joint : bones) {
    if (joint.lines.size() < 2) continue;
    Eigen::Vector3d end = Eigen::Vector3d::Zero();
    for (const BoneLine& line : joint.lines) end += line.end / static_cast<double>(joint.lines.size());
    joint.lines = {{joint.lines.front().start, end}};
  }
}

double distance_to(const MovingBones& bones, const Eigen::Vector3d& point) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const BoneLine& line : bones.lines) {
    nearest = std::min(nearest, geometry::distance_to_segment(point, line.start, line.end));
  }
  return nearest;
}

}  // namespace anigen::rig
