#pragma once
#include <vector>

#include "anigen/io/rigs/array_fields.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::io {

/// The skeleton of an Anymate sample and which joint each of its bones starts at (anymate_sample.h has the rules).
struct AnymateSkeleton {
  JointTree joints;            ///< not checked yet; empty when the sample has neither joints nor bones
  std::vector<int> bone_head;  ///< [K], index of a joint
};

AnymateSkeleton read_anymate_skeleton(const ArrayFields& fields);

}  // namespace anigen::io
