#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

namespace anigen::geometry {

/// Parameter t in [0, 1] of the point a + t (b − a) nearest to p; 0 for a segment without length.
inline double nearest_on_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d along = b - a;
  const double squared = along.squaredNorm();
  if (!(squared > 0.0)) return 0.0;
  return std::clamp((p - a).dot(along) / squared, 0.0, 1.0);
}

inline double distance_to_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return (a + nearest_on_segment(p, a, b) * (b - a) - p).norm();
}

/// The segments that a joint moves: from the joint to each of its children. A joint without children gets one that
/// goes on in the direction of its own bone for half of that bone's length, so that tips own something; a skeleton
/// of a single joint, or a tip on top of its parent, keeps the point.
struct BoneSegment {
  Eigen::Vector3f start, end;
};

/// @return [J], at least one segment each
std::vector<std::vector<BoneSegment>> bone_segments(const std::vector<Eigen::Vector3f>& joints,
                                                    const std::vector<int>& parents);

/// Distance from a point to the nearest of the segments.
float distance(const Eigen::Vector3f& point, const std::vector<BoneSegment>& segments);

/// The joint with the nearest segment, of every point [P]; the lower index wins ties. @throws InputError without joints
std::vector<std::size_t> nearest_moving_joints(const std::vector<Eigen::Vector3f>& points,
                                               const std::vector<std::vector<BoneSegment>>& segments);

/// @throws InputError when lengths differ, a parent is out of range, or a position is not finite
void check_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

/// The segment from a joint's parent to the joint.
struct Bone {
  int parent = -1, joint = -1;
  Eigen::Vector3d head = Eigen::Vector3d::Zero();  ///< parent's position
  Eigen::Vector3d tail = Eigen::Vector3d::Zero();  ///< joint's position
};

/// One bone per joint that has a parent, in joint order. A skeleton without any gives its joints as bones without
/// length (parent = joint), as the bone metrics want (docs/reference/training.md, 7).
/// @throws InputError as check_joints()
std::vector<Bone> bones_of(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

}  // namespace anigen::geometry
