#pragma once
#include "anigen/eval/image/views.h"
#include "anigen/eval/motion/motion.h"
#include "anigen/eval/pair/pair_result.h"
#include "anigen/eval/pair/pair_settings.h"
#include "anigen/eval/surface/category_references.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// Ground truth and prediction in the frame they are scored in.
struct ComparedShapes {
  io::RiggedShape predicted, truth;
  Alignment alignment;
};

/// What the prediction should be recognised as, and among what.
struct CategoryQuestion {
  const CategoryReferences* references = nullptr;  ///< null: not asked
  std::string expected;                            ///< the truth's category; may be empty
  std::string truth_id;                            ///< no reference of this id may answer
};

/// What both sides of a pair do in the metric `motion_distance` and in pictures of it: the same frames.
struct MovedPair {
  Motion truth, predicted;
};

/// The truth's motion (truth_motion()) and, retargeted, the prediction's. @param given a motion for the truth in place
/// of its own; null: its own @pre both have joints @throws InputError as check()
MovedPair same_motion(const ComparedShapes& shapes, const PairSettings& settings, const Motion* given);

/// @throws InputError when the shapes have nothing to align by
ComparedShapes bring_together(const io::RiggedShape& predicted, const io::RiggedShape& truth,
                              const PairSettings& settings);

/// Every metric of metric_table() that the pair allows, each other one with its reason. Definitions: docs/metrics.md.
/// Runs on the calling thread; several pairs may be evaluated at once.
/// @param perceptual LPIPS, when there is a network for it
/// @param category for the metric of that name
/// @param motion as in same_motion(); settings.motion describes it
/// @throws InputError when nothing can be compared at all
PairResult evaluate_pair(const io::RiggedShape& predicted, const io::RiggedShape& truth, const PairSettings& settings,
                         const PerceptualDistance& perceptual = nullptr, const CategoryQuestion& category = {},
                         const Motion* motion = nullptr);

}  // namespace anigen::eval
