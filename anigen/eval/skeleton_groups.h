#pragma once
#include <optional>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"

namespace anigen::eval {

/// A comparison in which every skeleton of the truth counts once: assets of one joint tree (tree_signature()) are often
/// one skeleton under many shapes, and no independent samples. Ids are the trees; a value is the mean over those assets
/// of the tree that have one, so that intervals and differences are over skeletons.
/// @return nothing where every asset has a tree of its own, or trees are not known
std::optional<Comparison> by_skeleton(const Comparison& comparison);

/// Methods × headline metrics that have values: mean ± half of the 95 % interval (bootstrap over skeletons).
/// @param skeletons of by_skeleton()
Table skeleton_mean_table(const Comparison& skeletons);

/// {"skeletons": n, "methods": {label: {key: {"mean", "low", "high", "n"}}}}
Json skeleton_json(const Comparison& skeletons);

}  // namespace anigen::eval
