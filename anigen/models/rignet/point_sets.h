#pragma once
#include "anigen/models/rignet/edge_set.h"

namespace anigen::models::rignet {

/// Joints of several meshes in the same rows.
struct PointSets {
  Tensor positions;  ///< [N, 3] fp32
  Tensor starts;     ///< [B + 1] int64: rows starts[b] to starts[b + 1] - 1 belong to mesh b; none is empty

  PointSets to(torch::Device device) const { return {positions.to(device), starts.to(device)}; }
};

/// Some of the points as centres, and edges to each from the points around it (Qi et al. 2017, PointNet++).
struct Balls {
  PointSets centres;
  EdgeSet edges;  ///< from points to centres
};

/// Centres by farthest-point sampling, ceil(ratio · N) of each set, beginning with the point farthest from the set's
/// mean, so that neither chance nor the order of points decides; and all points within `radius` of each, the nearest
/// `most` of them. @return on the device of the points @throws InputError for shapes or an empty set
Balls gather_balls(const PointSets& points, double ratio, double radius, std::int64_t most = 64);

/// Values of coarse points at fine ones: means of the three nearest of the same set, weighted by inverse squared
/// distances; fewer where there are fewer. @param values [M, C] @return [N, C] @throws InputError for shapes
Tensor interpolated(const PointSets& coarse, const Tensor& values, const PointSets& fine);

}  // namespace anigen::models::rignet
