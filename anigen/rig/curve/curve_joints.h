#pragma once
#include <cstddef>

#include "anigen/asset/skeleton.h"
#include "anigen/rig/curve/curve_tree.h"

namespace anigen::rig {

struct CurveJointRules {
  double bend = 0.0;          ///< a joint goes where the curve is farther than this from the line between two joints
  double longest_bone = 0.0;  ///< bones longer than this are cut into equal parts
};

/// Joints at the branches, ends and bends of a curve, and where bones would be too long. The root is the branch (of a
/// curve without one, the joint) nearest to the centre of mass: points weigh length times radius squared.
/// Names are geometry::joint_names(). @param tree not empty
Skeleton curve_joints(const CurveTree& tree, const CurveJointRules& rules);

}  // namespace anigen::rig
