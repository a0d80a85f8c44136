#pragma once
#include <vector>

#include "anigen/models/rignet/dense_layers.h"
#include "anigen/models/rignet/mesh_graph.h"

namespace anigen::models::rignet {

/// What comes to each point along its edges: the largest, channel by channel, of MLP([x_i, x_j − x_i]) over the edges
/// from j to i, the MLP being two layers of out channels (reference anymate-baselines.md, 9.3). The first layer is
/// linear in both halves, so it is computed once per point and added per edge. Keys `first.*`, `norm.*`, `second.*`.
class EdgeMessageImpl : public torch::nn::Module {
 public:
  EdgeMessageImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x, const EdgeSet& edges);  ///< @param x [V, in] @return [V, out]

 private:
  std::int64_t in_;
  nn::Linear first_ = nullptr;
  torch::nn::BatchNorm1d norm_ = nullptr;
  ReluNorm second_ = nullptr;
};
TORCH_MODULE(EdgeMessage);

/// GMEdgeConv: messages of half the channels along either set of edges, side by side through one layer. Keys `ring.*`,
/// `ball.*`, `mix.*`.
class GraphUnitImpl : public torch::nn::Module {
 public:
  GraphUnitImpl(std::int64_t in, std::int64_t out);         ///< @throws InputError unless out is even
  Tensor forward(const Tensor& x, const MeshGraph& graph);  ///< @param x [V, in] @return [V, out]

 private:
  EdgeMessage ring_ = nullptr, ball_ = nullptr;
  ReluNorm mix_ = nullptr;
};
TORCH_MODULE(GraphUnit);

/// Units after each other, what all of them give side by side. Keys `0.*`, `1.*`, …
class GraphStackImpl : public torch::nn::Module {
 public:
  explicit GraphStackImpl(const std::vector<std::int64_t>& widths);  ///< of the input, then of each unit
  Tensor forward(Tensor x, const MeshGraph& graph);                  ///< @return [V, sum of the units' widths]

 private:
  std::vector<GraphUnit> units_;
};
TORCH_MODULE(GraphStack);

}  // namespace anigen::models::rignet
