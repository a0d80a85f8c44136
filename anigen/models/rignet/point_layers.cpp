#include "anigen/models/rignet/point_layers.h"

namespace anigen::models::rignet {

SetAbstractionImpl::SetAbstractionImpl(double ratio, double radius, const std::vector<std::int64_t>& widths)
    : ratio_(ratio), radius_(radius) {
  mlp_ = register_module("mlp", DenseStack(widths));
}

SetAbstractionImpl::Result SetAbstractionImpl::forward(const PointSets& points, const Tensor& features) {
  const Balls balls = gather_balls(points, ratio_, radius_);
  Tensor seen = edge_sums(-balls.centres.positions, points.positions, balls.edges);
  if (features.defined()) seen = torch::cat({features.index_select(0, balls.edges.sources), seen}, 1);
  return {balls.centres, run_maxima(mlp_(seen), balls.edges.offsets)};
}

Tensor with_positions(const Tensor& features, const PointSets& points) {
  return torch::cat({features, points.positions}, 1);
}

}  // namespace anigen::models::rignet
