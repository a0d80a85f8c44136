#pragma once
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"

namespace anigen::eval {

/// Groups of assets that count as one sample: the joint tree of each asset (tree_signature()), or a name of its own
/// where that is not known. Empty where every asset has a tree of its own, or trees are not known: then assets are the
/// samples.
std::vector<std::string> independent_units(const Comparison& comparison);

/// A comparison in which every skeleton of the truth counts once: assets of one joint tree (tree_signature()) are often
/// one skeleton under many shapes, and no independent samples. Ids are the trees; a value is the mean over those assets
/// of the tree that have one, so that intervals are over skeletons.
/// @return nothing where every asset has a tree of its own, or trees are not known
std::optional<Comparison> by_skeleton(const Comparison& comparison);

/// Methods × headline metrics that have values: mean ± half of the 95 % interval (bootstrap over skeletons), with the
/// assets behind them. @param skeletons of by_skeleton() @param comparison that it was made of
Table skeleton_mean_table(const Comparison& skeletons, const Comparison& comparison);

/// {"skeletons": n, "methods": {label: {key: {"mean", "low", "high", "n"}}}}
Json skeleton_json(const Comparison& skeletons);

}  // namespace anigen::eval
