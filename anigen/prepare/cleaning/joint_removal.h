#pragma once
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen::prepare {

/// Takes joints out of an asset. What stays keeps its world transform in the bind pose, in the rest pose and in every
/// animation; keys of joints that hang elsewhere afterwards are made anew at the times of all keys that moved them.
/// Where several joints are left without a parent, the one nearest to their mean becomes the root and takes the others
/// (reference anymate-baselines.md, 1.3).
/// @param heir per joint: itself when it stays, else the joint that stays, of a smaller number, which gets its weights
/// and children, or -1 for a joint without weights above all that stay
/// @throws Error when no joint stays or an heir is none of these
void remove_joints(Asset& asset, const std::vector<int>& heir);

/// Per joint, whether some vertex has weight on it.
std::vector<char> weighted_joints(const Asset& asset);

}  // namespace anigen::prepare
