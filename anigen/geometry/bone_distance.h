#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::geometry {

/// The segment from a joint's parent to the joint.
struct Bone {
  int parent = -1, joint = -1;
  Eigen::Vector3d head = Eigen::Vector3d::Zero();  ///< parent's position
  Eigen::Vector3d tail = Eigen::Vector3d::Zero();  ///< joint's position
};

/// One bone per joint that has a parent, in joint order. A skeleton without any gives its joints as bones without
/// length (parent = joint), as the bone metrics want (reference training-and-data.md, 7).
/// @throws InputError when lengths differ, a parent is out of range, or a position is not finite
std::vector<Bone> bones_of(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

/// Exact point–segment distances, row-major [P, B].
std::vector<double> bone_distances(const std::vector<Eigen::Vector3d>& points, const std::vector<Bone>& bones);

struct NearestBone {
  int bone = -1;  ///< index into bones; the lowest of equally near ones
  double distance = 0.0;
};

/// The nearest bone of every point, [P]. @throws InputError when there is no bone
std::vector<NearestBone> nearest_bones(const std::vector<Eigen::Vector3d>& points, const std::vector<Bone>& bones);

}  // namespace anigen::geometry
