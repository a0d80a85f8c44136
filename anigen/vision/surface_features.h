#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "anigen/geometry/ray_caster.h"
#include "anigen/prepare/metadata.h"

namespace anigen::vision {

/// Hits of rays from a point on the surface, in the mesh's unit of length.
struct SurfaceSight {
  double near_openness = 1.0, far_openness = 1.0;  ///< share of directions free within the two radii, [0, 1]
  double thickness = 1.0;                          ///< along −normal, at most 1
  double gap = 1.0;                                ///< along +normal, at most 1
};

/// Casts 32 rays spread evenly over the cosine-weighted hemisphere about the normal, and one along either normal.
/// @param foot on the surface @param normal unit length @param lift how far off the surface the rays start, so that
///   the surface does not hide itself
SurfaceSight look_around(const geometry::RayCaster& caster, const Eigen::Vector3d& foot, const Eigen::Vector3d& normal,
                         double lift, double near_radius, double far_radius);

/// Feature model `surface`: sixteen numbers per surface voxel, computed from the mesh and its colours alone, so that
/// small configurations need neither views nor downloaded weights. Ours, not published. All lengths are taken at the
/// nearest point of the surface to the voxel's centre, below called the foot; its normal follows the file's.
///
/// | channel | value | unit | range |
/// |---|---|---|---|
/// | 0–2 | foot − centre | voxel edges | [-1, 1] each |
/// | 3–5 | smooth normal at the foot (the file's, else area-weighted) | — | unit length |
/// | 6–8 | base colour at the foot: material factor × texture × vertex colour | linear RGB | [0, 1] |
/// | 9 | openness within 1/16: share of cosine-weighted rays about the normal that meet nothing nearer | — | [0, 1] |
/// | 10 | openness within 1/4 | — | [0, 1] |
/// | 11 | thickness: way along −normal to the next surface; 1 where there is none | object sizes | [0, 1] |
/// | 12 | gap: way along +normal to the next surface; 1 where there is none | object sizes | [0, 1] |
/// | 13 | mean curvature over the 26 neighbours that are surface voxels and face the same way; > 0 where convex |
///   1 / voxel edge | [-1, 1] |
/// | 14 | bend: 1 − length of the mean normal of the voxel and its 26 neighbours (0 flat, 1 opposite sheets) | — |
///   [0, 1] |
/// | 15 | crowding: surface voxels among the 5³ around (the voxel included) / 125 | — | (0, 1] |
inline constexpr int kSurfaceChannels = 16;
inline constexpr double kNearRadius = 1.0 / 16.0, kFarRadius = 1.0 / 4.0;  ///< of openness, object sizes

using SurfaceFeature = std::array<float, kSurfaceChannels>;

/// The features in fp32, one per voxel in the order given; the same whatever the number of threads.
/// @param asset normalised into [-0.5, 0.5]³ @param resolution of the voxel grid
/// @throws InputError for a malformed mesh or material, an undecodable texture, a voxel outside the grid or given
///   twice, or a bad resolution
std::vector<SurfaceFeature> surface_features(const Asset& asset, const std::vector<geometry::Voxel>& voxels,
                                             int resolution);

/// As above, as an extractor of dataset preparation: float16 [N, 16], rounded to nearest.
class SurfaceFeatures : public prepare::FeatureExtractor {
 public:
  std::string name() const override { return "surface"; }
  std::string fingerprint() const override { return "surface version 1"; }
  int channels() const override { return kSurfaceChannels; }
  bool needs_views() const override { return false; }
  io::NdArray extract(const prepare::FeatureRequest& request) const override;
};

}  // namespace anigen::vision
