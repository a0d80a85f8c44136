#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen {

struct Influence {
  std::int32_t joint;
  float weight;
};

/// Sparse rows (joint, weight), one row per vertex, each summing to 1, heaviest influence first, no joint twice
/// in a row, no zero weights. Row v is influences[offsets[v]] … influences[offsets[v + 1] - 1].
struct SkinWeights {
  std::vector<std::size_t> offsets{0};  ///< [V + 1]
  std::vector<Influence> influences;

  std::size_t rows() const { return offsets.size() - 1; }
  std::size_t row_size(std::size_t v) const { return offsets[v + 1] - offsets[v]; }
  const Influence* row(std::size_t v) const { return influences.data() + offsets[v]; }
  std::size_t largest_row() const;

  /// Appends a row: merges repeated joints, drops weights ≤ 0 or not finite, divides by the sum, sorts.
  /// @return false when nothing positive was left; the row then is empty and the caller must repair it
  bool append_row(std::vector<Influence> row);
  /// Appends a row of other weights as it is.
  void append_copy(const SkinWeights& other, std::size_t row);
};

/// Keeps the `count` heaviest influences of every row and divides by their sum.
SkinWeights limit_influences(const SkinWeights& weights, std::size_t count);

/// Row-major [V, J]; rows sum to 1.
std::vector<float> to_dense(const SkinWeights& weights, std::size_t joints);
/// @param dense row-major [rows, joints]; entries ≤ threshold are dropped and rows divided by their sum. A row
/// with nothing left becomes weight 1 on joint 0 (what the published SkinAE trainer does).
/// @param unweighted gets the number of such rows, unless null
SkinWeights from_dense(const std::vector<float>& dense, std::size_t rows, std::size_t joints, float threshold = 0.0f,
                       std::size_t* unweighted = nullptr);

/// Largest distance from its anchor at which a joint may move a vertex of a generated asset, in hops along the
/// skeleton: 2 · max(1, ⌊J / 10⌋) (docs/reference/flows.md, 5.7).
int published_max_hops(std::size_t joints);

/// Drops the weights of joints that are farther than `max_hops` from the vertex' anchor and divides what is left by its
/// sum (docs/reference/flows.md, 5.7): a learned decoder gives every joint some weight, so that a hand would follow the
/// other hand a little. A row with a sum of 1e-8 or less becomes weight 1 on its anchor.
/// @param hops [J][J] distances along the undirected skeleton, as skeleton_field::hop_distances gives them
/// @param anchors [V] a joint per vertex; empty: the heaviest joint of its row, joint 0 for a row without weights
/// @throws InputError when hops is not square, anchors has another length, or a joint is out of range
SkinWeights filter_skin(const SkinWeights& skin, const std::vector<std::vector<int>>& hops, int max_hops,
                        const std::vector<int>& anchors = {});

struct SkinSmoothing {
  int iterations = 100;
  double alpha = 1.0;  ///< share that the neighbours get; from 1 on a vertex has no say in its own weights

  /// Treatment of a vertex without edges: false: it keeps its weights. True: as published, α = 1 leaves it without
  /// any (an empty row), a smaller α keeps them.
  bool empties_isolated = false;
};

/// Weights averaged over the mesh (docs/reference/flows.md, 5.7): `iterations` times
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
