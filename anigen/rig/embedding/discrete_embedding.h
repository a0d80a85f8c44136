#pragma once
#include <cstddef>
#include <vector>

#include "anigen/rig/embedding/embedding_penalties.h"

namespace anigen::rig {

struct DiscreteEmbedding {
  std::vector<int> vertices;  ///< [K], of the sphere graph, one per reduced joint
  double penalty = 0.0;
  bool best = false;       ///< no embedding that breaks no rule costs less
  std::size_t states = 0;  ///< partial embeddings that were taken up
};

/// Vertices for the joints of a reduced skeleton with the least penalty: best-first search over joints in order
/// (reference anymate-baselines.md, 9.2, stage 7). What a partial embedding must still cost at least is the published
/// bound carried down the tree: for a subtree that is not placed yet, the least sum of penalties that concern one bone
/// each, over all ways to place it. The result is that of the published search, which takes up far more states.
///
/// Where no embedding keeps all rules below a cost of 1, or the search has taken up options.most_states, a beam search
/// that may break rules gives the answer: a rule that is broken costs 1. Time is so bounded by
/// (most_states + joints · beam_width) · spheres, memory by most_states · spheres.
DiscreteEmbedding discrete_embedding(const SphereGraph& graph, const ReducedSkeleton& skeleton,
                                     const EmbeddingOptions& options);

}  // namespace anigen::rig
