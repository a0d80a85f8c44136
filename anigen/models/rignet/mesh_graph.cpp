#include "anigen/models/rignet/mesh_graph.h"

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

// Runs after runs: offsets of the following ones move by what came before.
Tensor appended_offsets(const std::vector<Tensor>& offsets) {
  std::vector<Tensor> parts = {offsets.front()};
  Tensor before = offsets.front().slice(0, -1);
  for (std::size_t i = 1; i < offsets.size(); ++i) {
    parts.push_back(offsets[i].slice(0, 1) + before);
    before = parts.back().slice(0, -1);
  }
  return torch::cat(parts);
}

EdgeSet joined_edges(const std::vector<MeshGraph>& graphs, EdgeSet MeshGraph::*edges) {
  std::vector<Tensor> offsets, sources;
  std::int64_t before = 0;
  for (const MeshGraph& graph : graphs) {
    offsets.push_back((graph.*edges).offsets);
    sources.push_back((graph.*edges).sources + before);
    before += graph.vertices.size(0);
  }
  return {appended_offsets(offsets), torch::cat(sources)};
}

}  // namespace

MeshGraph joined(const std::vector<MeshGraph>& graphs) {
  anymate::require(!graphs.empty(), "graphs", "there is none");
  std::vector<Tensor> vertices, starts;
  for (const MeshGraph& graph : graphs) {
    vertices.push_back(graph.vertices);
    starts.push_back(graph.starts);
  }
  return {torch::cat(vertices), joined_edges(graphs, &MeshGraph::ring), joined_edges(graphs, &MeshGraph::ball),
          appended_offsets(starts)};
}

Tensor starts_of(const std::vector<std::int64_t>& counts) {
  std::vector<std::int64_t> starts = {0};
  for (const std::int64_t count : counts) starts.push_back(starts.back() + count);
  return torch::tensor(starts, torch::kInt64);
}

Tensor spread(const Tensor& rows, const Tensor& starts) { return rows.index_select(0, run_of_rows(starts)); }

}  // namespace anigen::models::rignet
