#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::eval {

/// What a sample's distance to the other mesh means.
enum class SurfaceDistance {
  kSampleToSurface,  ///< to the nearest point of the surface, exact. The default: two copies of a surface score 0
                     ///< whatever their tessellation, and the score does not depend on how densely the other mesh is
                     ///< sampled
  kSampleToSample    ///< to the nearest sample of the other surface: the reference's definition
                   ///< (training-and-data.md, 7.5). Never smaller; two independent samplings of one surface stay about
                   ///< ½ √(area / samples) apart
};

/// "sample-to-surface", "sample-to-sample". @throws InputError for another word
SurfaceDistance surface_distance(const std::string& word);
std::string to_string(SurfaceDistance definition);

struct SurfaceOptions {
  std::size_t samples = 100000;  ///< area-uniform, per mesh
  std::uint64_t seed = 0;
  SurfaceDistance definition = SurfaceDistance::kSampleToSurface;
};

/// Between meshes in the frame of scores (truth's longest side 1). Distances are not squared. Definitions as in
/// point_cloud_metrics.h, with the prediction as A; thresholds of the F-scores are 0.01 and 0.05.
struct SurfaceScores {
  double chamfer = 0.0;
  double fscore_001 = 0.0, precision_001 = 0.0, recall_001 = 0.0;
  double fscore_005 = 0.0, precision_005 = 0.0, recall_005 = 0.0;
  double hausdorff = 0.0;           ///< of the samples: a lower bound of the surfaces'
  double normal_consistency = 0.0;  ///< with the normals of faces, not smoothed
};

/// Samples come from the streams (seed, "surface metrics"), the same for both meshes. Runs on the calling thread.
/// @throws InputError when a mesh has no faces or bad ones, a position is not finite, or samples is 0
SurfaceScores surface_scores(const Mesh& prediction, const Mesh& truth, const SurfaceOptions& options = {});

/// The same with search structures that exist already, which belong to the same meshes.
SurfaceScores surface_scores(const Mesh& prediction, const geometry::NearestSurface& prediction_surface,
                             const Mesh& truth, const geometry::NearestSurface& truth_surface,
                             const SurfaceOptions& options = {});

}  // namespace anigen::eval
