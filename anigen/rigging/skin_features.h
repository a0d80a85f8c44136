#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rigging {

/// Version of the features. A network that learned from one takes no other, and cached ones of another are made again.
inline constexpr int kSkinFeatureVersion = 2;
/// Joints that a vertex may follow, at most.
inline constexpr std::size_t kSkinCandidates = 16;
/// Added to classical weights inside logarithms.
inline constexpr double kClassicalFloor = 1e-4;

/// Features of a pair of a vertex and a candidate joint, which stands for its bones to its children as everywhere in
/// rigging/ (geometry/bones.h). Lengths are in units of the mesh's size: twice the root of the mean squared distance of
/// its surface from the surface's middle. None of them depends on frame, scale or order of vertices, joints and faces,
/// but for what classical weights do (geodesic voxels lie along the axes).
enum SkinPairFeature : std::size_t {
  // Logarithms of classical weights w + kClassicalFloor; the network takes these four for the first ones.
  kHeatLog,         ///< bone heat, by the published constants
  kGeodesicLog,     ///< geodesic voxels
  kHeatAround,      ///< of the mean of heat over the neighbours along edges
  kGeodesicAround,  ///< of the mean of geodesic voxels over them
  kBoneDistance,    ///< straight distance to the nearest of the joint's bones
  kDistanceRank,    ///< candidates that are nearer, divided by their number
  kDistanceRatio,   ///< log of the distance over that of the nearest candidate, both + 1e-3
  kAlongBone,       ///< place along the nearest bone: 0 at its joint, 1 at its end, from −2 before to 3 beyond
  kBoneLength,      ///< of that bone
  kFacing,          ///< cosine between the normal and the way to the nearest point of the bones; 0 without a normal
  kShellHeatShare,  ///< part of the joint's heat, by area, that is in the vertex' shell (SurfaceParts)
  kShellReach,      ///< log of the shell's distance from the bones over that of the nearest shell, both + 1e-3
  kShellSize,       ///< root of the shell's part of the area
  kHops,            ///< joints between it and the best classical candidate along the skeleton, an eighth, at most 1
  kDepthStep,       ///< joints that it lies deeper than that candidate, a quarter, in [−1, 1]
  kChildren,        ///< joints that hang on it, a quarter, at most 1
  kLeaf,            ///< 1 without any
  kDepth,           ///< joints between it and the root, by the deepest joint's
  // Parts of the shell's area that prefer the joint: log(share + 1e-3).
  kShellHeat,         ///< by heat
  kShellGeodesic,     ///< by geodesic voxels
  kShellNearest,      ///< by the nearest bone alone
  kShellInverse,      ///< by the distance of bones, 1 / (d + 0.01)^4
  kJointDistance,     ///< straight distance to the joint itself
  kParentDistance,    ///< to its parent, for a root to itself
  kShellMiddle,       ///< distance of the joint from the middle of the shell's area
  kShellMiddleRatio,  ///< log of that over the shell's radius, both + 0.02
  kShellRadius,       ///< root of the mean squared distance of the shell from its middle
  kJointGap,          ///< distance of the joint from the nearest other joint, at most 10
  kParentGap,         ///< from its parent; 0 for a root
  kRoot,              ///< 1 without a parent
  kBelow,             ///< log of the number of joints below and itself, a quarter
  kSurfaceHeat,       ///< log(share + 1e-3) of all heat, by area
  kSurfaceNearest,    ///< of all area, by the nearest bone alone
  kSkinPairFeatures
};

/// About the mean and the standard deviation of a feature of pairs over public rigs, for networks that want numbers
/// about 0 and 1.
struct SkinFeatureScale {
  float middle, spread;
};
const std::array<SkinFeatureScale, kSkinPairFeatures>& skin_feature_scales();

/// Features of an asset.
enum SkinAssetFeature : std::size_t {
  kJointCount,         ///< log of the number of joints, a quarter
  kShellCount,         ///< log of the number of shells, a quarter
  kHeatRigidity,       ///< median over vertices of the largest weight by heat
  kGeodesicRigidity,   ///< by geodesic voxels
  kLargestShellShare,  ///< of the area
  kSkinAssetFeatures
};

struct SkinFeatureOptions {
  std::size_t candidates = kSkinCandidates;  ///< per vertex, at least 1
  int resolution = 256;                      ///< of geodesic voxels, as GeodesicVoxelOptions
};

/// Candidates of some places with their features.
struct SkinPairs {
  std::vector<std::int32_t> joints;  ///< [N, K], no joint twice in a row; −1 where there are fewer joints than K
  std::vector<float> features;  ///< [N, K, kSkinPairFeatures]; weights of 0 and other zeros where there is no joint
};

/// Inputs of a network that corrects classical weights. Places are the different positions of vertices (WeldedSurface):
/// vertices at one place get the same weights. Candidates of a place are taken in turn from the joints of largest
/// weight by heat, of largest weight by geodesic voxels, and of the nearest bones, until there are K; the lower index
/// of equals.
class SkinFeatures {
 public:
  /// Binds by heat and by geodesic voxels; the results do not depend on the number of threads.
  /// @throws InputError as bind_by_heat(), bind_by_geodesic_voxels(), or without candidates
  SkinFeatures(const Mesh& mesh, const Skeleton& skeleton, const SkinFeatureOptions& options = {});
  ~SkinFeatures();
  SkinFeatures(const SkinFeatures&) = delete;
  SkinFeatures& operator=(const SkinFeatures&) = delete;

  std::size_t places() const;
  std::size_t candidates() const;
  const std::vector<std::int32_t>& place_of_vertex() const;  ///< [V]
  const std::vector<std::int32_t>& shell_of_place() const;   ///< [P]
  /// Places at the other ends of the edges at a place, ascending.
  const std::int32_t* neighbors_begin(std::size_t place) const;
  const std::int32_t* neighbors_end(std::size_t place) const;

  /// The classical weights, one row per place, of as many influences as there are candidates.
  const SkinWeights& heat() const;
  const SkinWeights& geodesic() const;
  const std::array<float, kSkinAssetFeatures>& asset() const;
  /// On all threads. @param places any, in any order @return one row each
  SkinPairs pairs(const std::vector<std::int32_t>& places) const;

 private:
  struct State;
  std::unique_ptr<const State> state_;
};

}  // namespace anigen::rigging
