#pragma once
#include <optional>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/prepare/cleaning/cleaning.h"

namespace anigen::prepare {

/// Merges joints within `distance` of an earlier one into the first such joint, which gets their children and weights;
/// merged joints attract no others, so chains do not shrink to a point.
/// @return what was merged, if anything
std::optional<CleaningFinding> merge_duplicate_joints(Asset& asset, double distance);

/// Takes away joints without weights: those with no weighted joint below, or all of them.
/// @return what was pruned, if anything
std::optional<CleaningFinding> prune_unused_joints(Asset& asset, UnusedJoints which);

}  // namespace anigen::prepare
