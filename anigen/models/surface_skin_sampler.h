#pragma once
#include <vector>

#include "anigen/core/random.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

/// Probability of each face in an area-weighted draw: areas clamped to at least 1e-12, all equal when an area is not
/// finite (reference training-and-data.md, 3.1).
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

}  // namespace anigen::models
