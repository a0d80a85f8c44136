#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::metrics {

/// Points on a surface with the unit normals of their faces, counter-clockwise side out.
struct SurfaceSamples {
  std::vector<Eigen::Vector3d> points, normals;
  std::vector<std::int32_t> faces;
};

/// Draws area-uniform points from the stream (seed, purpose, 0): geometry::sample_surface, in the order drawn, so that
/// the first n of more are again a uniform sample. A point on a face without area has the normal 0.
/// @throws InputError without faces, on a bad index or a position that is not finite
SurfaceSamples sample_mesh(const Mesh& mesh, std::size_t count, std::uint64_t seed, std::string_view purpose);

/// Points ordered by face: neighbours in the list are neighbours on the surface, which makes long runs of
/// nearest-point queries quicker. For sums over all samples, which do not care.
SurfaceSamples sorted_by_face(const SurfaceSamples& samples);

/// Distances between two point sets A and B, as everything below needs them: computed once with k-d trees.
struct CloudDistances {
  std::vector<double> to_b, to_a;  ///< [A] from each a to the nearest b; [B] from each b to the nearest a
  std::vector<std::size_t> nearest_b, nearest_a;  ///< which one it is
};

/// @throws InputError when a set is empty, or naming a point that is not finite
CloudDistances cloud_distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b);

/// ½ (mean_a d(a, B) + mean_b d(b, A)), distances not squared: the paper's Chamfer (docs/reference/training.md, 7.5).
double chamfer_l1(const CloudDistances& distances);
/// mean_a d² + mean_b d².
double chamfer_l2(const CloudDistances& distances);
/// The largest of all d.
double hausdorff(const CloudDistances& distances);

/// Knapitsch et al. 2017: with A the prediction and B the truth, precision is the share of A within the threshold of B,
/// recall the share of B within the threshold of A, and the F-score their harmonic mean, 0 when both are 0. A point at
/// exactly the threshold is not within.
struct FScore {
  double precision = 0.0, recall = 0.0, fscore = 0.0;
};
/// @throws InputError unless the threshold is positive
FScore fscore(const CloudDistances& distances, double threshold);

/// ½ (mean_a |n_a · n_nearest b| + mean_b |n_b · n_nearest a|): 1 for parallel surfaces, whichever way they face.
/// @param a_normals,b_normals unit length, or 0 where there is none, which scores 0
/// @throws InputError when there is not one normal per point
double normal_consistency(const CloudDistances& distances, const std::vector<Eigen::Vector3d>& a_normals,
                          const std::vector<Eigen::Vector3d>& b_normals);

/// Meaning of a sample's distance to the other mesh.
enum class SurfaceDistance {
  kSampleToSurface,  ///< to the nearest point of the surface, exact. The default: two copies of a surface score 0
                     ///< whatever their tessellation, and the score does not depend on how densely the other mesh is
                     ///< sampled
  kSampleToSample    ///< to the nearest sample of the other surface: the reference's definition
                     ///< (docs/reference/training.md, 7.5). Never smaller; two independent samplings of one surface
                     ///< stay about ½ √(area / samples) apart
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

/// Samples come from the streams (seed, "surface metrics"), the same for both meshes. Faces without area count on
/// neither side, unless a mesh has no others. Runs on the calling thread.
/// @throws InputError when a mesh has no faces or bad ones, a position is not finite, or samples is 0
SurfaceScores surface_scores(const Mesh& prediction, const Mesh& truth, const SurfaceOptions& options = {});

/// As above, with search structures that exist already, which belong to the same meshes; faces without area count.
SurfaceScores surface_scores(const Mesh& prediction, const geometry::NearestSurface& prediction_surface,
                             const Mesh& truth, const geometry::NearestSurface& truth_surface,
                             const SurfaceOptions& options = {});

}  // namespace anigen::metrics
