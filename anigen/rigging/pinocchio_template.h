#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"

namespace anigen::rigging {

struct TemplateJoint {
  std::string name;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< a mesh of longest side 1 around the origin, Z up, facing −Y
  int parent = -1;
  int mirror = -1;       ///< the same joint of the other side of the body
  bool foot = false;     ///< stands on the ground
  bool fat = false;      ///< lies where the body is thick: hips, chest, head
  bool guide = false;    ///< a tip: tells how far the limb goes, and is left out of the result
  bool carried = false;  ///< too small to be looked for: goes where the joint it hangs on goes
};

/// Joints with parents before children, one root first. Guides are leaves. The joints that are not carried are a tree.
struct TemplateSkeleton {
  std::string name;
  std::vector<TemplateJoint> joints;
  Eigen::Vector3d box = Eigen::Vector3d::Ones();  ///< sides of the box of the mesh that the joints are meant for
};

/// Any skeleton as a template.
///  - Mirrored joints are found by name (left and right, or a lone L and R) and else by position.
///  - Chains shorter than 0.12 of the box that branch off a longer one are carried (fingers but one, eyes, ears), and
///  so
///    are joints between the root and the first branch (a root on the ground).
///  - Feet are tips in the lowest tenth of the joints' height; joints in the middle where the tree branches are fat.
/// @param box of the mesh that the skeleton belongs to; empty: the joints' own box fills 0.9 of the longest side
/// @throws InputError without joints, for parents that do not come first, or joints that are not finite or all in one
/// point
TemplateSkeleton template_from_skeleton(const Skeleton& skeleton, const Box& box = {});

/// @throws InputError naming template and joint: parents not before children, several roots, a mirror out of range, a
/// position that is not finite or farther than 10 from the origin, a box without extent, a guide with children, fewer
/// than two joints to look for
void check(const TemplateSkeleton& skeleton);

/// A joint where the template branches or ends, and the bone from the one before (docs/reference/riggers.md, 2, step
/// 5).
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

}  // namespace anigen::rigging
