#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::geometry {
class NearestSurface;
}

namespace anigen::models {

/// How features move from the vertices of a mesh to points in space: each point takes a weighted mean of three
/// vertices. Worked out once per asset without gradients; linear in the features, so that gradients flow through
/// mixed().
struct VertexMix {
  torch::Tensor vertices;  ///< [Q, 3] int64
  torch::Tensor weights;   ///< [Q, 3] fp32
  std::int64_t points() const { return vertices.defined() ? vertices.size(0) : 0; }
};

/// Sum of clamped barycentric weights below which they are divided by this instead.
inline constexpr double kEncoderLeastWeight = 1e-6;  ///< reference autoencoders.md, 3.3
inline constexpr double kLossLeastWeight = 1e-3;     ///< reference autoencoders.md, 3.11

/// Given places on the mesh: weights are clamped to at least 0 and divided by max(sum, least).
/// @param face [Q] integers @param barycentric [Q, 3] @param faces [F, 3] integers
/// @throws InputError when shapes do not fit or a face does not exist
VertexMix surface_mix(const torch::Tensor& face, const torch::Tensor& barycentric, const torch::Tensor& faces,
                      double least = kEncoderLeastWeight);
/// Nearest places on the surface. On a triangle with 4 · area² below 1e-12 the weights are those of the nearest place
/// on its longest edge, as published.
/// @param points [Q, 3] @param vertices [V, 3], faces [F, 3]: the mesh that `surface` was made of
VertexMix nearest_surface_mix(const geometry::NearestSurface& surface, const torch::Tensor& vertices,
                              const torch::Tensor& faces, const torch::Tensor& points,
                              double least = kEncoderLeastWeight);
/// Each point takes the nearest vertex, the lowest index of equally near ones. @param vertices [V, 3] finite
VertexMix nearest_vertex_mix(const torch::Tensor& vertices, const torch::Tensor& points);

/// @param features [V, C] @return [Q, C]
torch::Tensor mixed(const torch::Tensor& features, const VertexMix& mix);

}  // namespace anigen::models
