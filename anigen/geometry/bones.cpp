#include "anigen/geometry/bones.h"

#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::geometry {

std::vector<std::vector<BoneSegment>> bone_segments(const std::vector<Eigen::Vector3f>& joints,
                                                    const std::vector<int>& parents) {
  std::vector<std::vector<BoneSegment>> segments(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parents[j] >= 0) {
      const auto parent = static_cast<std::size_t>(parents[j]);
      segments[parent].push_back({joints[parent], joints[j]});
    }
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!segments[j].empty()) continue;
    const Eigen::Vector3f from = parents[j] >= 0 ? joints[at(parents[j])] : joints[j];
    segments[j].push_back({joints[j], joints[j] + 0.5f * (joints[j] - from)});
  }
  return segments;
}

float distance(const Eigen::Vector3f& point, const std::vector<BoneSegment>& segments) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const BoneSegment& segment : segments) {
    nearest = std::min(
        nearest, distance_to_segment(point.cast<double>(), segment.start.cast<double>(), segment.end.cast<double>()));
  }
  return static_cast<float>(nearest);
}

std::vector<std::size_t> nearest_moving_joints(const std::vector<Eigen::Vector3f>& points,
                                               const std::vector<std::vector<BoneSegment>>& segments) {
  if (segments.empty()) throw InputError("", "", "nearest joints of a skeleton without joints");
  std::vector<std::size_t> joints(points.size(), 0);
  parallel_for(points.size(), [&](std::size_t p) {
    float least = distance(points[p], segments[0]);
    for (std::size_t j = 1; j < segments.size(); ++j) {
      const float d = distance(points[p], segments[j]);
      if (d < least) {
        least = d;
        joints[p] = j;
      }
    }
  });
  return joints;
}

void check_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  if (positions.size() != parents.size()) {
    throw InputError(
        "", "skeleton",
        std::to_string(positions.size()) + " joint positions but " + std::to_string(parents.size()) + " parents");
  }
  for (std::size_t j = 0; j < parents.size(); ++j) {
    const std::string index = "[" + std::to_string(j) + "]";
    if (parents[j] < -1 || parents[j] >= static_cast<int>(parents.size()))
      throw InputError("", "skeleton.parents" + index, "there is no joint " + std::to_string(parents[j]));
    if (!positions[j].allFinite()) throw InputError("", "skeleton.positions" + index, "the position is not finite");
  }
}

std::vector<Bone> bones_of(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  check_joints(positions, parents);
  std::vector<Bone> bones;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] >= 0) bones.push_back({parents[j], static_cast<int>(j), positions[at(parents[j])], positions[j]});
  }
  if (bones.empty()) {
    for (std::size_t j = 0; j < positions.size(); ++j)
      bones.push_back({static_cast<int>(j), static_cast<int>(j), positions[j], positions[j]});
  }
  return bones;
}

}  // namespace anigen::geometry
