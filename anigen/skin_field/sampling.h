#pragma once
#include <string>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::skin_field {

/// The skeletons of several assets, one below the other, as the skin models take them. Joint order within an asset is
/// the caller's; a skeleton may have several roots, and a root need not be joint 0.
struct SkeletonBatch {
  torch::Tensor joints;       ///< [ΣJ, 3] object space, float
  torch::Tensor parent_rows;  ///< [ΣJ] int64, row of the parent joint; ΣJ (one past the end) for a root
  torch::Tensor anchor_rows;  ///< [ΣJ] int64, row of the parent joint; for a root, row of its asset's joint 0
  nn::Ragged items{{}};       ///< joints per asset, each at least 1

  /// @param joints per asset [J, 3] floating @param parents per asset [J] integers, -1 for roots
  /// @param file for messages
  /// @throws InputError naming the asset: shapes, dtypes, empty skeletons, parents outside [-1, J), non-finite joints
  static SkeletonBatch from_lists(const std::vector<torch::Tensor>& joints, const std::vector<torch::Tensor>& parents,
                                  const std::string& file = "");

  SkeletonBatch to(torch::Device device) const;
};

/// Probability of each face in an area-weighted draw: areas clamped to at least 1e-12, all equal when an area is not
/// finite (docs/reference/training.md, 3.1).
/// @param vertices [V, 3] fp32 @param faces [F, 3] integers @return [F] fp32, sums to 1
/// @throws InputError on wrong shapes, no faces or a face that names no vertex
torch::Tensor face_probabilities(const torch::Tensor& vertices, const torch::Tensor& faces);

/// Skin weights at points (1−√u, √u(1−v), √u·v) of the given faces.
/// @param skin [V, J] fp32, CPU @param faces [F, 3] int64, valid @param face [K] int64 in [0, F) @param u, v [K] in [0,
/// 1)
/// @return [K, J]
torch::Tensor interpolate_skin(const torch::Tensor& skin, const torch::Tensor& faces, const torch::Tensor& face,
                               const torch::Tensor& u, const torch::Tensor& v);

/// Draws skin weights at uniformly distributed points of a mesh surface, again and again; what SkinAE trains on
/// instead of the vertices, whose density is the artist's. Set up once per mesh.
class SurfaceSkinSampler {
 public:
  /// @param vertices [V, 3] @param faces [F, 3] integers @param skin [V, J], rows sum to 1
  /// @throws InputError as face_probabilities, and when skin is not [V, J]
  SurfaceSkinSampler(const torch::Tensor& vertices, const torch::Tensor& faces, const torch::Tensor& skin);

  /// @return [count, J] fp32; the same for the same state of rng
  torch::Tensor sample(std::int64_t count, Rng& rng) const;

 private:
  torch::Tensor faces_, skin_;
  std::vector<double> cumulative_;  ///< [F] running sum of areas, rising
};

}  // namespace anigen::skin_field

namespace anigen::geometry {
class NearestSurface;
}  // namespace anigen::geometry

namespace anigen::skin_field {

/// Interpolation of features from the vertices of a mesh to points in space: each point takes a weighted mean of three
/// vertices. Worked out once per asset without gradients; linear in the features, so that gradients flow through
/// mixed().
struct VertexMix {
  torch::Tensor vertices;  ///< [Q, 3] int64
  torch::Tensor weights;   ///< [Q, 3] fp32
  std::int64_t points() const { return vertices.defined() ? vertices.size(0) : 0; }
};

/// Sum of clamped barycentric weights below which they are divided by this instead.
inline constexpr double kEncoderLeastWeight = 1e-6;  ///< docs/reference/autoencoders.md, 4.3
inline constexpr double kLossLeastWeight = 1e-3;     ///< docs/reference/training.md, 3.5

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

}  // namespace anigen::skin_field
