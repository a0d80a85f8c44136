#pragma once
#include <vector>

#include "anigen/models/rignet/edge_set.h"

namespace anigen::models::rignet {

/// Meshes as RigNet's networks see them, one after another in the same rows, so that meshes of any size form a batch.
/// Frame: longest side 1, Y up, x and z centred, lowest y 0 (reference anymate-baselines.md, 9.3).
struct MeshGraph {
  Tensor vertices;  ///< [V, 3] fp32
  EdgeSet ring;     ///< from the vertices that share an edge with each, and from itself
  EdgeSet ball;     ///< from some of those within a geodesic ball around each, and from itself
  Tensor starts;    ///< [B + 1] int64: rows starts[b] to starts[b + 1] - 1 are mesh b

  std::int64_t meshes() const { return starts.size(0) - 1; }
  MeshGraph to(torch::Device device) const {
    return {vertices.to(device), ring.to(device), ball.to(device), starts.to(device)};
  }
};

/// The same meshes in one batch. @param graphs at least one, on the same device
MeshGraph joined(const std::vector<MeshGraph>& graphs);

/// [B + 1] int64 from the number of rows of each item, on the CPU.
Tensor starts_of(const std::vector<std::int64_t>& counts);

/// One row per item as one row per row of the items. @param rows [B, C] @param starts [B + 1] @return [starts[B], C]
Tensor spread(const Tensor& rows, const Tensor& starts);

}  // namespace anigen::models::rignet
