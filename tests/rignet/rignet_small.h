#pragma once
#include <vector>

#include "anigen/rignet/graph.h"
#include "anigen/rignet/model.h"

namespace anigen::rignet {

/// A model of RigNet that is small enough to be run in a test.
inline RignetOptions small_rignet(Task task) {
  RignetOptions options;
  options.task = task;
  options.width = 0.05;
  options.dropout = 0.0;
  return options;
}

/// Edges into each of `vertices` from itself and from others, as many as `most` of them, drawn from LibTorch's
/// generator.
inline EdgeSet random_edges(std::int64_t vertices, std::int64_t most) {
  std::vector<std::int64_t> counts, sources;
  for (std::int64_t v = 0; v < vertices; ++v) {
    const std::int64_t others = torch::randint(0, most + 1, {1}).item<std::int64_t>();
    counts.push_back(1 + others);
    sources.push_back(v);
    const Tensor drawn = torch::randint(0, vertices, {others});
    for (std::int64_t i = 0; i < others; ++i) sources.push_back(drawn[i].item<std::int64_t>());
  }
  return {starts_of(counts), torch::tensor(sources, torch::kInt64)};
}

inline MeshGraph random_graph(std::int64_t vertices) {
  return {torch::rand({vertices, 3}), random_edges(vertices, 5), random_edges(vertices, 9), starts_of({vertices})};
}

/// Edges after vertices were renumbered: row i of the new order is row order[i] of the old one.
inline EdgeSet renumbered(const EdgeSet& edges, const Tensor& order) {
  const Tensor place = order.argsort();
  std::vector<std::int64_t> counts;
  std::vector<Tensor> sources;
  for (std::int64_t i = 0; i < order.size(0); ++i) {
    const auto old = order[i].item<std::int64_t>();
    const auto first = edges.offsets[old].item<std::int64_t>(), last = edges.offsets[old + 1].item<std::int64_t>();
    counts.push_back(last - first);
    sources.push_back(place.index_select(0, edges.sources.slice(0, first, last).flip(0)));
  }
  return {starts_of(counts), torch::cat(sources)};
}

inline MeshGraph renumbered(const MeshGraph& graph, const Tensor& order) {
  return {graph.vertices.index_select(0, order), renumbered(graph.ring, order), renumbered(graph.ball, order),
          graph.starts};
}

/// One mesh with some joints, everything between them inside.
inline ConnectivityInput small_input(std::int64_t vertices, std::int64_t joints) {
  return connectivity_input({random_graph(vertices)}, {torch::rand({joints, 3}) - torch::tensor({0.5F, 0.0F, 0.5F})},
                            {torch::ones({joints, joints})});
}

/// Largest difference of two tensors.
inline double difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

}  // namespace anigen::rignet
