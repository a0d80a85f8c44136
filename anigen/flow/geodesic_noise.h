#pragma once
#include <cstdint>

#include "anigen/core/config_fields.h"
#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

/// Noise that neighbouring voxels share: skin weights change slowly along a surface (the published variant "gsn";
/// docs/reference/flows.md, 4.4). Trainer arguments `geodesic_smooth_noise`, `…_iters` and `…_alpha`.
struct GeodesicNoiseOptions : JsonOptions<GeodesicNoiseOptions> {
  bool enabled = false;
  std::int64_t iterations = 0;
  double alpha = 0.7;  ///< how far a voxel goes towards its neighbours in one iteration, in [0, 1]

  void fields(ConfigFields& f);
};

/// Pairs of voxels of an item that share a face.
struct FaceNeighbours {
  Tensor row, neighbour;  ///< [E] int64: every pair in both directions
  Tensor degree;          ///< [N] int64: neighbours of each row, 0 to 6
};

/// @param coords [N, 4] integers: item, x, y, z, each at least 0; no voxel twice
FaceNeighbours face_neighbours(const Tensor& coords);

/// f ← (1 − alpha) f + alpha · mean of the face neighbours, as often as `iterations` says, for the channels [first,
/// last); a voxel without neighbours keeps its value. Then each of these channels is divided by its standard deviation
/// over the voxels of all items (unbiased, at least 1e-8); its mean stays. The other channels are left alone, and so
/// is everything when the options are not enabled.
/// @param noise [N, C] @return [N, C]
Tensor smooth_geodesic_noise(const Tensor& noise, const FaceNeighbours& neighbours, std::int64_t first,
                             std::int64_t last, const GeodesicNoiseOptions& options);
/// Overload that finds the neighbours from the voxels, which are not read when the options are not enabled. @param
/// coords [N, 4]
Tensor smooth_geodesic_noise(const Tensor& noise, const Tensor& coords, std::int64_t first, std::int64_t last,
                             const GeodesicNoiseOptions& options);

}  // namespace anigen::flow
