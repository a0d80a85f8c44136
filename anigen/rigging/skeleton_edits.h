#pragma once
#include <cstddef>
#include <string>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"

namespace anigen::rigging {

/// Changes of a skeleton that a user asks for, whoever proposed its joints. Joints have no axes of their own (identity
/// rotations); names of joint_names() are made anew, other joints keep theirs.

struct SkeletonEdits {
  std::size_t joints = 0;  ///< wanted number; 0: any
  bool symmetric = false;  ///< left and right mirror each other
  bool extend = false;     ///< joints of the mesh's own or a given skeleton are joined by some for what it leaves out

  bool any() const { return joints > 0 || symmetric || extend; }
};

/// A skeleton of exactly `count` joints. Too many: joints go that matter least, by how far a bend of the skeleton would
/// move (a joint inside a chain) or by the length of the bone that would be lost (an end or a fork); their children go
/// to their parents. Too few: the longest bones are halved. Joints that mirror each other (mirrored_joints()) go and
/// come in pairs while the number allows it. O(joints²).
/// @param count 1 or more
Skeleton with_joint_count(const Skeleton& skeleton, std::size_t count);

/// A skeleton that the plane x = `middle` mirrors. Joints whose mirror images are near each other become exact mirror
/// images at the mean of both; those near their own image, and only children of such, go onto the plane; a branch
/// without a counterpart is copied to the other side, its names with the other side's word.
/// @param size of the mesh, by which near is measured: its box's diagonal
Skeleton mirrored_skeleton(const Skeleton& skeleton, double middle, double size);

/// A skeleton with branches of another one where it has no bone itself, such as a tail or ears. A joint of `other` is
/// reached when a bone of `skeleton` is no farther than 1.5 times the distance from the joint to the surface, or 4 % of
/// the box's diagonal; connected joints that are not, of together more than 6 % of the diagonal, become a
/// branch of the nearest joint, named `added_1_00` and so on. The first joints are those of `skeleton`, unchanged.
/// @param other of the same mesh, such as its curve (propose_curve_skeleton())
Skeleton extended_skeleton(const Skeleton& skeleton, const Skeleton& other, const Mesh& mesh);

}  // namespace anigen::rigging
