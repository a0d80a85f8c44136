#pragma once
#include <cstdint>

#include "anigen/loaders/rignet/rignet_mesh.h"
#include "anigen/loaders/rignet/surface_paths.h"
#include "anigen/models/rignet/mesh_graph.h"

namespace anigen::loaders {

/// A mesh as one graph (reference anymate-baselines.md, 9.3): edges from the one-ring of each vertex, and from at most
/// ten vertices, drawn by (seed, vertex), of those within 0.06 of it along the surface; either time also from itself.
models::rignet::MeshGraph mesh_graph(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed);

/// Positions as rows, [N, 3] fp32.
torch::Tensor position_rows(const std::vector<Eigen::Vector3f>& points);

}  // namespace anigen::loaders
