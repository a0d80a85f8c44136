#pragma once
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// Joins joints that coincide or nearly do, as the cleaning rule `duplicate_joints` of data sets does: parents first, a
/// joint within `distance` of one that stays goes into the first such joint, which gets its children and weights.
/// Rigs hold such joints for animators (twist helpers, first joints of fingers, ends of bones), and nothing in a shape
/// tells them apart.
/// @param distance in the shape's unit
/// @return joints that went. When some did, clips are dropped: they name the old joints.
std::size_t merge_joints(io::RiggedShape& shape, double distance);

}  // namespace anigen::eval
