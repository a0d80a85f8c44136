#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/rig/embedding/embedding_template.h"

namespace anigen::rig {

/// A joint where the template branches or ends, and the bone from the one before (reference anymate-baselines.md, 9.2,
/// stage 5).
struct ReducedJoint {
  int joint = 0;    ///< of the template
  int parent = -1;  ///< of the reduced skeleton
  int mirror = -1;  ///< of the reduced skeleton
  bool foot = false, fat = false, leaf = false;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double length = 0.0;                      ///< along the joints that were taken out
  std::vector<int> chain;                   ///< joints of the template after the parent, this one last
  std::vector<double> fractions;            ///< where they are along the bone; the last is 1
  std::vector<Eigen::Vector3d> directions;  ///< to each of them from the one before, not of unit length
};

/// The template without its carried joints and those that only continue a limb; the topmost joint that is not carried
/// is first and always kept. Parents come before children.
struct ReducedSkeleton {
  std::vector<ReducedJoint> joints;
  std::vector<std::vector<int>> children;
};

/// @param scale of positions and lengths @throws InputError as check()
ReducedSkeleton reduced_skeleton(const TemplateSkeleton& skeleton, double scale);

}  // namespace anigen::rig
