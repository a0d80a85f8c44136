#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::rig {

/// A skeleton whose joints are measured by the bounding box of its mesh: 0 at the lower, 1 at the upper side of each
/// axis. Joints may lie outside.
struct BoxedSkeleton {
  std::string id;
  std::vector<Eigen::Vector3d> joints;  ///< [J]
  std::vector<int> parents;             ///< [J], -1 for the root
};

/// @throws InputError naming `id` when there is no joint, a number is not finite, or the box is empty. Along an axis
/// without extent every joint is at 0.5.
BoxedSkeleton boxed_skeleton(const std::string& id, const std::vector<Eigen::Vector3d>& joints,
                             const std::vector<int>& parents, const Box& box);

/// Joints of a boxed skeleton in another box.
std::vector<Eigen::Vector3d> placed_joints(const BoxedSkeleton& skeleton, const Box& box);

/// The index of the skeleton with the least sum of distances to all others, the first of equals. Skeletons of different
/// trees have no mean that is one; the medoid is the mean's nearest relative that is always a skeleton. Distance is
/// the symmetric mean of nearest-joint distances (J2J) in box coordinates. O(N² J²), on all threads.
/// @throws InputError without skeletons
std::size_t medoid(const std::vector<BoxedSkeleton>& skeletons);

}  // namespace anigen::rig
