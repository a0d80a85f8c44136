#pragma once
#include <optional>

#include "anigen/metrics/metric_skeleton.h"

namespace anigen::metrics {

/// In which order the children of a joint are read. The distance between ordered trees depends on it.
enum class ChildOrder {
  kIndex,      ///< by joint index, as RigNet's and Anymate's evaluation do
  kCanonical,  ///< largest subtree first, equal sizes by their shape: independent of how joints are numbered, so that
               ///< trees of the same shape are at distance 0. An upper bound on the distance of unordered trees.
};

/// Steps of the dynamic programme that are still done (a few seconds), and pairs of joints (128 MB).
inline constexpr double kMostTreeEditSteps = 1e9, kMostTreeEditPairs = 1.6e7;

/// The least number of joints to insert and delete to turn one tree into the other; renaming is free, positions do
/// not count (Zhang and Shasha 1989; what APTED computes; docs/reference/anymate.md, 6.3; docs/reference/rignet.md, 6).
/// Several roots count as children of one that both sides share, which changes nothing for trees.
/// @return nothing beyond kMostTreeEditSteps or kMostTreeEditPairs (trees of thousands of joints)
std::optional<int> tree_edit_distance(const MetricSkeleton& a, const MetricSkeleton& b,
                                      ChildOrder order = ChildOrder::kCanonical);

}  // namespace anigen::metrics
