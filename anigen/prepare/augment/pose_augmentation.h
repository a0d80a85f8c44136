#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/core/json.h"
#include "anigen/prepare/augment/pose_checks.h"
#include "anigen/prepare/augment/provenance.h"

namespace anigen::prepare {

/// How further samples are made of an asset by posing it (paper, section 4.1.1; reference training-and-data.md,
/// section 6). Probability and largest angle are the paper's; it gives nothing of the rest.
struct PoseAugmentation {
  bool own_motion = true;          ///< poses from the asset's animations where they move it; false: always random
  double blend_probability = 0.5;  ///< share of those poses that lie between two times of a clip, see OwnMotion
  double least_motion = 0.02;      ///< a clip that moves the mesh less (RMS, of its longest side) is not used
  double probability = 0.8;        ///< of each joint to be turned, in a random pose
  double max_angle = 60.0;         ///< degrees, 0 … 180; angles are uniform between 0 and this
  bool include_root = true;        ///< the root is a joint like any other: the whole object turns
  int attempts = 8;                ///< draws of one kind before giving up, 1 … 1000
  PoseLimits limits;

  /// @throws InputError naming the option that is out of range
  void validate() const;
};

/// Every option, for fingerprints and for the dataset card.
Json to_json(const PoseAugmentation& options);

/// Changes whenever the same arguments would give other variants.
inline constexpr int kPoseRecipe = 1;

/// Name of variant k as a dataset entry: SHA-256 of "pose/<recipe>/<source id>/<seed>/<k>/<options>".
std::string variant_id(const std::string& source_id, std::uint64_t seed, std::size_t k,
                       const PoseAugmentation& options);

/// The posed variants of one asset: set up once, asked for any k, from any thread.
///
/// An asset with animations is posed by its own motion (OwnMotion): place k along it is frac(u + k · 0.618…), so that
/// the first K variants spread evenly over everything the asset does, however many are asked for; u is drawn per
/// asset. With `blend_probability` the pose lies between that moment and another of the same clip. When no clip can be
/// used, or none of `attempts` poses passes, poses are random: each joint is turned, with `probability`, about its bind
/// position and a uniform random axis, by an angle uniform in [0, max_angle].
///
/// A variant is the source's mesh under linear blend skinning (file normals turn with their surroundings), moved into
/// [-0.5, 0.5]³ again. The pose is its bind pose and its rest pose alike; joint orientations follow, with the frames
/// being stripped of their scale where a sheared pose could not be written as translation, rotation and scale. Faces,
/// weights, UVs, colours, materials and images are the source's. Animations are dropped: their keys mean a
/// motion of the source's rest pose.
///
/// A function of (seed, source id, k, options, asset) alone. Poses that degenerate (PoseChecks) are drawn anew.
class PoseAugmenter {
 public:
  /// @param normalised longest side 1; kept by reference, so it must outlive the augmenter
  /// @throws InputError for an option out of range, or when validate() finds something wrong with mesh, skeleton or
  /// skin. Broken animations are no error: they are not used, and the provenance of each variant names them
  PoseAugmenter(const Asset& normalised, std::string source_id, std::uint64_t seed, PoseAugmentation options = {});
  ~PoseAugmenter();
  PoseAugmenter(PoseAugmenter&&) noexcept;
  PoseAugmenter& operator=(PoseAugmenter&&) noexcept;

  /// @return nothing when every pose drawn was rejected; `provenance.rejections` then says why, one entry per draw
  std::optional<Asset> variant(std::size_t k, Provenance& provenance) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// One variant. For several of the same asset, PoseAugmenter does the common work once.
std::optional<Asset> posed_variant(const Asset& normalised, const std::string& source_id, std::uint64_t seed,
                                   std::size_t k, const PoseAugmentation& options, Provenance& provenance);

}  // namespace anigen::prepare
