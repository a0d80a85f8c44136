#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/rig/binding/welded_surface.h"

namespace anigen::rig {

struct BoneLine {
  Eigen::Vector3d start, end;
};

/// What a joint moves (geometry/bone_segments.h).
struct MovingBones {
  std::vector<BoneLine> lines;  ///< at least one
  bool is_tip = false;          ///< the joint has no children: its line is made up, and may leave the body
};

/// The bones of every joint, [J], in the unit frame of a surface. Joints more than a million of the surface's sizes
/// away count as that far.
/// @throws InputError without joints, or naming one that is not finite or whose parent does not come before it
std::vector<MovingBones> moving_bones(const Skeleton& skeleton, const WeldedSurface& surface);

/// Makes one line of those of every joint with several children: to the middle of their ends. A root's lines to all its
/// children run through the whole body, and are nearest to most of it.
void join_lines(std::vector<MovingBones>& bones);

/// Distance from a point to the nearest of a joint's lines.
double distance_to(const MovingBones& bones, const Eigen::Vector3d& point);

/// @throws InputError as moving_bones
void require_joints(const Skeleton& skeleton);

}  // namespace anigen::rig
