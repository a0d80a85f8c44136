#pragma once
#include <cstddef>

#include "anigen/asset/mesh_edges.h"
#include "anigen/asset/skin_weights.h"

namespace anigen {

struct SkinSmoothing {
  int iterations = 100;
  double alpha = 1.0;  ///< share that the neighbours get; from 1 on a vertex has no say in its own weights

  /// What becomes of a vertex without edges: false: it keeps its weights. True: as published, α = 1 leaves it without
  /// any (an empty row), a smaller α keeps them.
  bool empties_isolated = false;
};

/// Weights averaged over the mesh (reference flows-and-pipeline.md, 5.9): `iterations` times
///     w_v ← (1 − α) w_v + α · mean over neighbours of w,    each row then divided by its sum,
/// neighbours along the edges of the mesh. An empty row stays empty until a neighbour has weights. Weights below 1e-7
/// at the end are dropped, since they are nothing beside the rounding of the others.
///
/// Vertices that were split at texture seams are not neighbours: smooth before splitting. Runs on all threads, over
/// blocks of joints; memory is what the result takes and two blocks of [V, 16] per thread. Rows do not depend on the
/// number of threads.
/// @param edges of the mesh, one row of skin per vertex @param joints J, more than every joint in a row
/// @throws InputError when an edge or a joint is out of range, iterations < 0, or alpha is not a number ≥ 0
SkinWeights smooth_skin(const SkinWeights& skin, const MeshEdges& edges, std::size_t joints,
                        const SkinSmoothing& options = {});

}  // namespace anigen
