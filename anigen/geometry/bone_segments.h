#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace anigen::geometry {

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

}  // namespace anigen::geometry
