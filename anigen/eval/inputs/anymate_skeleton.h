#pragma once
#include <vector>

#include "anigen/eval/inputs/array_fields.h"
#include "anigen/eval/joint_tree.h"

namespace anigen::eval {

/// The skeleton of an Anymate sample and which joint each of its bones starts at (anymate_sample.h has the rules).
struct AnymateSkeleton {
  JointTree joints;            ///< not checked yet; empty when the sample has neither joints nor bones
  std::vector<int> bone_head;  ///< [K], index of a joint
};

AnymateSkeleton read_anymate_skeleton(const ArrayFields& fields);

}  // namespace anigen::eval
