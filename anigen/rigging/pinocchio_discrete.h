#pragma once
#include <atomic>
#include <cstddef>
#include <vector>

#include "anigen/rigging/pinocchio_spheres.h"
#include "anigen/rigging/pinocchio_template.h"

namespace anigen::rigging {

/// The published constants (docs/reference/riggers.md, 2), which hold in a frame where the longest side of the mesh's
/// box is `size`; and what bounds time and memory.
struct EmbeddingOptions {
  double size = 0.9;
  int resolution = 128;             ///< cells of the distance field along the longest side, 8 to 512
  double tolerance = 0.003;         ///< medial points count when deeper than twice this
  std::size_t most_spheres = 1000;  ///< of the packing, 1 to 4,000

  std::size_t fat_candidates = 50;  ///< spheres, the largest, where a fat joint may lie
  double length_weight = 0.027, direction_weight = 0.023, symmetry_weight = 0.007, doubled_weight = 0.046,
         foot_weight = 0.014, duplicate_weight = 0.012, local_direction_weight = 0.072, extremity_weight = 0.005,
         disjoint_weight = 0.033;

  /// Partial embeddings that the search may take up before it ends in a good embedding that need not be the best, and
  /// how many of them at a time that one is sought with.
  std::size_t most_states = 5000, beam_width = 100;

  /// Also tries the template stretched along the axes as the mesh's box is from the template's, by no more than this
  /// factor either way, and takes the better one. That costs the sum of squared logarithms of the three factors by
  /// weight. 1: as published, the template has the proportions it has.
  double most_stretch = 2.0, stretch_weight = 0.1;

  int refinement_rounds = 10;  ///< 0: joints stay where the discrete embedding puts them
  double surface_weight = 15000.0, bone_length_weight = 0.25, bone_angle_weight = 2.0, bone_symmetry_weight = 1.0;

  bool keep_guides = false;  ///< tips of limbs are joints of the result too
};

/// @throws InputError naming the value that is out of its range
void check(const EmbeddingOptions& options);

struct DiscreteEmbedding {
  std::vector<int> vertices;  ///< [K], of the sphere graph, one per reduced joint
  double penalty = 0.0;
  bool best = false;       ///< no embedding that breaks no rule costs less
  bool given_up = false;   ///< every embedding costs more than the limit; there are no vertices
  std::size_t states = 0;  ///< partial embeddings that were taken up
};

/// Vertices for the joints of a reduced skeleton with the least penalty: best-first search over joints in order
/// (docs/reference/riggers.md, 2, step 7). What a partial embedding must still cost at least is the published bound
/// carried down the tree: for a subtree that is not placed yet, the least sum of penalties that concern one bone each,
/// over all ways to place it. The result is that of the published search, which takes up far more states.
///
/// If no embedding keeps all rules below a cost of 1, or the search has taken up options.most_states, a beam search
/// that may break rules gives the answer: a rule that is broken costs 1. Time is so bounded by
/// (most_states + joints · beam_width) · spheres, memory by most_states · spheres.
/// @param limit the search gives up when every embedding costs more; other threads may lower it meanwhile. Null: none
/// @param surcharge what is added to the penalty before it is compared with the limit
DiscreteEmbedding discrete_embedding(const SphereGraph& graph, const ReducedSkeleton& skeleton,
                                     const EmbeddingOptions& options, const std::atomic<double>* limit = nullptr,
                                     double surcharge = 0.0);

}  // namespace anigen::rigging
