#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/random.h"
#include "anigen/prepare/poses.h"

namespace anigen::prepare {

/// The asset in a pose, which becomes its bind pose and its rest pose: vertices by linear blend skinning, file normals
/// turned as the faces around them turned (vertices split at a seam share theirs), joint frames as given. Everything
/// else but the animations is copied; those are dropped. Not normalised.
///
/// When frames carry scale that differs by axis, a frame relative to its parent can be sheared, which translation,
/// rotation and scale cannot say; all frames are then replaced by their rotations. Frames are free to
/// choose: the mesh is at rest in this pose.
/// @param world joint → world of the pose, [J], finite and invertible
/// @param vertices of the pose, [V]: skin_vertices(asset, world)
Asset bake_pose(const Asset& asset, const std::vector<Eigen::Matrix4d>& world, std::vector<Eigen::Vector3f> vertices);

/// The first joint whose matrix is not finite, or flat: its smallest stretch below 1e-9 of its largest. Animations hide
/// things by scaling them to nothing.
std::optional<std::size_t> collapsed_joint(const std::vector<Eigen::Matrix4d>& world);

/// A pose out of an asset's own animations.
struct MotionPose {
  std::size_t clip = 0;                               ///< index into Asset::animations
  double time = 0.0, second_time = 0.0, blend = 0.0;  ///< as in Provenance
  Pose pose;
};

/// Everything an asset's animations do, as one line of poses that can be drawn from.
///
/// A clip is used when its keys are sound (finite, in order, of joints that exist) and the mesh moves between them:
/// over 33 equally spaced times, some pose must differ from the first by `least_motion` (RMS over at most 256 vertices,
/// after the mean displacement is taken off, as a share of the longest side that they span in any pose of the clip:
/// there are files whose animations play at a hundredth of the bind pose's size). The usable clips lie one after
/// another on [0, 1), each as long as the way its vertices go: equal steps on the line are equal amounts of movement,
/// so a clip that pauses gives no crowd of equal poses, and a long idle does not outweigh a short jump.
///
/// Poses are interpolated within a clip, in two ways. At one time: the channels between their keys, as glTF plays them.
/// Between two times of the same clip: every joint's translation and scale linearly, its rotation on the shorter
/// arc, from the pose at `time` by `blend` in [0, ½) towards the pose at `second_time`. Never across clips.
class OwnMotion {
 public:
  /// @param asset kept by reference
  OwnMotion(const Asset& asset, double least_motion);

  bool empty() const { return clips_.empty(); }
  /// The pose at a place of [0, 1); other numbers are clamped.
  MotionPose at(double place) const;
  /// `first`, moved towards a pose at a time uniform in the same clip by a blend uniform in [0, ½).
  MotionPose blended(const MotionPose& first, Rng& rng) const;
  /// Poses at the times of keys, of any channel, of the clips that are used: each time once, clip by clip.
  std::size_t key_frames() const { return key_frames_.size(); }
  MotionPose key_frame(std::size_t i) const;  ///< @pre i < key_frames()
  /// "<name>: <reason>", for every clip that is not used.
  const std::vector<std::string>& unused() const { return unused_; }

 private:
  struct Clip {
    std::size_t index = 0;
    double begin = 0.0, end = 0.0;  ///< seconds: first and last key
    std::vector<double> way;        ///< vertices' way up to each of the sampled times; way[0] = 0
  };

  const Asset* asset_;
  std::vector<Clip> clips_;
  std::vector<std::pair<std::size_t, double>> key_frames_;  ///< clip, as an index into animations, and time
  std::vector<std::string> unused_;
  double total_way_ = 0.0;
};

/// Options of posed variants of an asset (paper, section 4.1.1; docs/reference/training.md, 6). Probability and largest
/// angle are the paper's; it gives nothing of the rest.
struct PoseAugmentation {
  bool own_motion = true;          ///< poses from the asset's animations where they move it; false: always random
  bool key_frames = false;         ///< own motion alone, and that at its key frames: neither blends nor random poses
  double blend_probability = 0.5;  ///< share of those poses that lie between two times of a clip, see OwnMotion
  double least_motion = 0.02;      ///< a clip that moves the mesh less (RMS, of its longest side) is not used
  double probability = 0.8;        ///< of each joint to be turned, in a random pose
  double max_angle = 60.0;         ///< degrees, 0 … 180; angles are uniform between 0 and this
  double anisotropic_scale = 0.0;  ///< each axis of the variant by exp(u), u uniform in ± this, 0 … 1
  bool include_root = true;        ///< the root is a joint like any other: the whole object turns
  int attempts = 8;                ///< draws of one kind before giving up, 1 … 1000
  PoseLimits limits;

  /// @throws InputError naming the option that is out of range
  void validate() const;
};

ANIGEN_JSON_RECORD(PoseAugmentation, own_motion, blend_probability, least_motion, probability, max_angle, include_root,
                   attempts, limits)

/// The options as JSON, key_frames and anisotropic_scale only where they are set: what was made without keeps its ids.
Json settings_of(const PoseAugmentation& options);

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
/// With `key_frames` variant k is the k-th key frame of the asset's clips in an order drawn for the asset, or another
/// of them when that one degenerates; there are no more variants than key frames, and none of an asset without clips.
/// Anymate's data have up to three such samples of an asset (docs/reference/anymate.md, 1.1).
///
/// A variant is the source's mesh under linear blend skinning (file normals turn with their surroundings), its axes
/// scaled where `anisotropic_scale` says so, moved into [-0.5, 0.5]³ again. The pose is its bind pose and its rest pose
/// alike; joint orientations follow, with the frames being stripped of their scale where a sheared pose could not be
/// written as translation, rotation and scale. Faces, weights, UVs, colours, materials and images are the source's.
/// Animations are dropped: their keys mean a motion of the source's rest pose.
///
/// A function of (seed, source id, k, options, asset) alone. Poses that degenerate (PoseChecks) are drawn anew.
class PoseAugmenter {
 public:
  /// @param normalised longest side 1; kept by reference, so it must outlive the augmenter
  /// @throws InputError for an option out of range, or when validate() finds something wrong with mesh, skeleton or
  /// skin. Broken animations are no error: they are not used, and the provenance of each variant names them
  PoseAugmenter(const Asset& normalised, std::string source_id, std::uint64_t seed, PoseAugmentation options = {});

  /// @return nothing when every pose drawn was rejected; `provenance.rejections` then says why, one entry per draw
  std::optional<Asset> variant(std::size_t k, Provenance& provenance) const;

 private:
  struct Draw;
  Draw draw(PoseKind kind, std::size_t k, int attempt, Provenance& provenance) const;
  Eigen::Vector3d axis_factors(std::size_t k) const;
  MotionPose own_pose(std::size_t k, int attempt, Rng& rng) const;
  /// Vertices of the pose; nothing when a limit is broken, with the sentence in `problem`.
  std::optional<std::vector<Eigen::Vector3f>> accepted(const std::vector<Eigen::Matrix4d>& world,
                                                       PoseMeasures& measures, std::string& problem) const;

  const Asset* asset_;
  std::string source_id_;
  std::uint64_t seed_;
  PoseAugmentation options_;
  PoseChecks checks_;
  Pose bind_;
  OwnMotion motion_;
  double first_place_;                    ///< u
  std::vector<std::size_t> frame_order_;  ///< of key frames
};

}  // namespace anigen::prepare
