#pragma once
#include <array>
#include <cstddef>

#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/skin_evaluation.h"

namespace anigen::eval {

/// Scores of one method in which every skeleton counts once: rigs of one joint tree (tree_signature()) are often one
/// skeleton under many shapes, and no independent samples.
struct SkeletonMeans {
  static constexpr std::size_t kScores = 3;  ///< l1, KL, deformation error

  std::size_t skeletons = 0, assets = 0;
  std::array<double, kScores> mean{};                ///< over skeletons, of means over their rigs
  std::array<Interval, kScores> interval{};          ///< 95 %, by bootstrap over skeletons
  std::array<PairedDifference, kScores> to_first{};  ///< against the first method, of the rigs that both have
};

/// All assets with scores, usable or not. @pre evaluation.poses > 0 @return no skeletons where nothing has scores
SkeletonMeans over_skeletons(const SkinEvaluation& evaluation, std::size_t method);

/// Methods × scores with half of their intervals, and differences from the first method.
anigen::Table skeleton_table(const SkinEvaluation& evaluation);

Json to_json(const SkeletonMeans& means);

}  // namespace anigen::eval
