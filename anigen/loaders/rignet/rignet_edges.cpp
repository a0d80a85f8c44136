#include "anigen/loaders/rignet/rignet_edges.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "anigen/asset/mesh_edges.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

constexpr double kBallRadius = 0.06;
constexpr std::size_t kMostInBall = 10;

using Neighbours = std::vector<std::vector<std::int64_t>>;

models::rignet::EdgeSet edges_of(const Neighbours& neighbours) {
  std::vector<std::int64_t> counts, sources;
  for (const std::vector<std::int64_t>& list : neighbours) {
    counts.push_back(static_cast<std::int64_t>(list.size()));
    sources.insert(sources.end(), list.begin(), list.end());
  }
  return {models::rignet::starts_of(counts), torch::tensor(sources, torch::kInt64)};
}

// Everyone is its own neighbour, first.
Neighbours themselves(std::size_t vertices) {
  Neighbours neighbours(vertices);
  for (std::size_t v = 0; v < vertices; ++v) neighbours[v].push_back(static_cast<std::int64_t>(v));
  return neighbours;
}

Neighbours one_ring(const RignetMesh& mesh) {
  Neighbours neighbours = themselves(mesh.vertices.size());
  const MeshEdges edges(mesh.faces, mesh.vertices.size());
  for (const MeshEdges::Edge& edge : edges.all()) {
    neighbours[at(edge[0])].push_back(edge[1]);
    neighbours[at(edge[1])].push_back(edge[0]);
  }
  return neighbours;
}

Neighbours geodesic_balls(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed) {
  Neighbours neighbours = themselves(mesh.vertices.size());
  for (std::size_t v = 0; v < neighbours.size(); ++v) {
    std::vector<std::int64_t> members;
    for (const auto& reached : paths.within(static_cast<std::int32_t>(v), kBallRadius)) {
      members.push_back(reached.vertex);
    }
    Rng rng(seed, "rignet ball", v);
    for (std::size_t i = 0; i < std::min(kMostInBall, members.size()); ++i) {
      std::swap(members[i], members[i + rng.index(members.size() - i)]);
      neighbours[v].push_back(members[i]);
    }
  }
  return neighbours;
}

}  // namespace

torch::Tensor position_rows(const std::vector<Eigen::Vector3f>& points) {
  torch::Tensor rows = torch::empty({static_cast<std::int64_t>(points.size()), 3});
  float* out = rows.data_ptr<float>();
  for (const Eigen::Vector3f& point : points) out = std::copy_n(point.data(), 3, out);
  return rows;
}

models::rignet::MeshGraph mesh_graph(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed) {
  return {position_rows(mesh.vertices), edges_of(one_ring(mesh)), edges_of(geodesic_balls(mesh, paths, seed)),
          models::rignet::starts_of({static_cast<std::int64_t>(mesh.vertices.size())})};
}

}  // namespace anigen::loaders
