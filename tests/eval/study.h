#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/eval/pair.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

// Known mistakes, made on purpose, to see which metrics notice (paper, section 4.1.3). All take a shape with joints,
// and return it changed; where the skeleton is too small for the mistake they throw InputError.

/// A joint in the middle of the longest bone; it moves nothing, so no weight changes.
io::RiggedShape with_inserted_joint(io::RiggedShape shape);

/// The largest subtree of at most half of the joints again, moved along x by `offset` of the longest side of the
/// joints' bounding box; original and copy share each weight equally.
io::RiggedShape with_duplicated_branch(io::RiggedShape shape, double offset = 0.001);

/// Hangs the subtree on the joint farthest from where it was; positions and weights stay.
io::RiggedShape with_reparented_subtree(io::RiggedShape shape);

/// A tenth of the joints, at least one, gone; drawn from (seed, "dropped joints") among those that are no root. What
/// they carried goes to their parents.
io::RiggedShape with_dropped_joints(io::RiggedShape shape, std::uint64_t seed = 0, double fraction = 0.1);

/// Every vertex' weights averaged with those of the vertices it shares an edge with, `rounds` times.
io::RiggedShape with_blurred_weights(io::RiggedShape shape, int rounds = 5);

/// A random rotation, a uniform scale in [0.2, 5] and a translation, from (seed, "placement").
io::RiggedShape with_random_placement(io::RiggedShape shape, std::uint64_t seed = 0);

/// Expected response of a metric to a mistake.
enum class Expected {
  kZero,      ///< stay near zero
  kPositive,  ///< see it
  kOpen       ///< either; nothing was claimed
};

struct Perturbation {
  std::string name;
  std::function<io::RiggedShape(io::RiggedShape)> apply;
  std::vector<std::pair<std::string, Expected>> expected;  ///< metric → written before it was measured
};

/// The five mistakes with their expectations, in the order of docs/metrics.md.
const std::vector<Perturbation>& perturbations();

// Behaviour of the metrics where the answer is known; the tables of docs/results.md.

/// A metric counts as zero below this: the mistakes move joints by a thousandth of the box.
inline constexpr double kStudyZero = 1e-3;

/// Every shape against itself, and against itself rotated, scaled and moved: the largest distance of each kind, and
/// how far the registration was off. One row per shape.
anigen::Table self_evaluation(const std::vector<io::RiggedShape>& shapes, const PairSettings& settings);

/// Every mistake of perturbations() on every shape, [mistake][shape]; a shape too small for one has a failure there. No
/// alignment: the frame is the truth's box.
using MistakeResults = std::vector<std::vector<PairResult>>;
MistakeResults evaluate_mistakes(const std::vector<io::RiggedShape>& shapes);

/// One row per mistake and metric: what was expected, the median over shapes, and on how many shapes it held.
anigen::Table sensitivity(const MistakeResults& results);

/// Scores of the pairs under every public convention: means of J2J, J2B and B2B over shapes, and their ratio to the
/// paper's definition.
anigen::Table conventions(const MistakeResults& results);

/// Broken and degenerate predictions of one shape and what becomes of each.
anigen::Table degenerate_inputs(const io::RiggedShape& shape);

}  // namespace anigen::eval
