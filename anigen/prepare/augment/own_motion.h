#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/core/random.h"

namespace anigen::prepare {

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
  /// "<name>: <reason>", for every clip that is not used.
  const std::vector<std::string>& unused() const { return unused_; }

 private:
  struct Clip {
    std::size_t index = 0;
    double begin = 0.0, end = 0.0;  ///< seconds: first and last key
    std::vector<double> way;        ///< vertices' way up to each of the sampled times; way[0] = 0
  };
  const Clip& clip_of(std::size_t index) const;

  const Asset* asset_;
  std::vector<Clip> clips_;
  std::vector<std::string> unused_;
  double total_way_ = 0.0;
};

/// What is wrong with a clip's keys; empty when nothing is.
std::string broken_keys(const Animation& animation, std::size_t joints);

}  // namespace anigen::prepare
