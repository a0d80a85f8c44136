#pragma once
#include <string>
#include <vector>

#include "anigen/eval/pair/pair_result.h"
#include "anigen/eval/pair/pair_settings.h"
#include "anigen/eval/tables.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

// What the metrics do where the answer is known; the tables of docs/metric_study.md.

/// A metric counts as zero below this: the mistakes move joints by a thousandth of the box.
inline constexpr double kStudyZero = 1e-3;

/// Every shape against itself, and against itself rotated, scaled and moved: the largest distance of each kind, and
/// how far the registration was off. One row per shape.
Table self_evaluation(const std::vector<io::RiggedShape>& shapes, const PairSettings& settings);

/// Every mistake of perturbations() on every shape, [mistake][shape]; a shape too small for one has a failure there. No
/// alignment: the frame is the truth's box.
using MistakeResults = std::vector<std::vector<PairResult>>;
MistakeResults evaluate_mistakes(const std::vector<io::RiggedShape>& shapes);

/// One row per mistake and metric: what was expected, the median over shapes, and on how many shapes it held.
Table sensitivity(const MistakeResults& results);

/// The same pairs under every public convention: means of J2J, J2B and B2B over shapes, and their ratio to the paper's
/// definition.
Table conventions(const MistakeResults& results);

/// Broken and degenerate predictions of one shape and what becomes of each.
Table degenerate_inputs(const io::RiggedShape& shape);

}  // namespace anigen::eval
