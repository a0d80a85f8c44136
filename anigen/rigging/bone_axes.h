#pragma once
#include <Eigen/Core>
#include <string>

#include "anigen/asset/skeleton.h"

namespace anigen::rigging {

/// Directions of the axes of joints in the bind pose.
enum class BoneAxes {
  kWorld,  ///< those of the file's world: no joint has a rotation
  kAlong   ///< y along the bone, as Blender and most engines draw bones
};

/// "world" or "along". @throws InputError for another word
BoneAxes parse_bone_axes(const std::string& word);

/// The skeleton with joints in the same places and other axes, without scale; rest pose = bind pose.
///
/// kAlong: y points to the only child; of several children to their mean where they lead the same way, else to the one
/// whose bones lead farthest, of which two that mirror each other are none (a pelvis looks up the spine). A joint at an
/// end goes on as its bone came. z is as near to `forward` as that allows, or to the world's up where a bone lies along
/// `forward`; of two mirrored joints the right one takes the choice of the left, so that equal rotations of both
/// mirror.
/// @param forward horizontal, unit: the direction that the body faces
Skeleton with_bone_axes(const Skeleton& skeleton, BoneAxes axes,
                        const Eigen::Vector3d& forward = -Eigen::Vector3d::UnitY());

}  // namespace anigen::rigging
