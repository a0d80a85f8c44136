#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/image.h"
#include "anigen/tracking/camera.h"
#include "anigen/tracking/objective.h"

namespace anigen::tracking {

struct TrackOptions {
  std::int64_t resolution = 128;  ///< of the finest level of the pyramid: pixels on a side, 32 … 1024
  int first_iterations = 60;      ///< of the first frame, at each level
  int iterations = 20;            ///< of every other frame, at each level
  int joint_iterations = 24;      ///< over all frames together; 0: none
  double rate = 0.04;             ///< step of the optimiser in radians
  ObjectiveWeights weights;
};

struct TrackedPoses {
  Tensor turns;   ///< [N, J, 3] fp64: rotation vectors after the bind pose's rotations, in the joint's axes
  Tensor shifts;  ///< [N, 3] fp64, of the root, in the rig's frame
  std::vector<double> overlaps;  ///< [N] intersection over union of silhouettes
  std::vector<Light> lights;     ///< [N]
  double seconds = 0.0;
};

/// A frame and the camera that took it.
struct TrackedFrame {
  io::Image image;  ///< square, with alpha
  std::string name;
  PinholeCamera camera;
};

/// Poses of a rig in the frames of a video. Frame by frame, from coarse to fine, each begun from the last one's pose
/// moved on as the one before it moved; then all frames at once, where |ω_t+1 − 2 ω_t + ω_t−1|² keeps the motion even.
/// VectorAdam on the rotation vectors of all free joints and the root's place. Deterministic for a number of
/// threads.
/// @param done called after each frame of the first pass and each iteration of the second
/// @throws InputError without frames, naming a frame that shows nothing, for options out of range, or for a camera that
/// is not finite or does not see the rig; Interrupted
TrackedPoses track(const RigTensors& rig, const std::vector<TrackedFrame>& frames, const TrackOptions& options,
                   const std::function<void()>& done = {});

/// Steps that track() reports.
std::size_t track_steps(std::size_t frames, const TrackOptions& options);

/// Poses as a clip. @param normalisation of the asset → the rig's frame @param fps frames per second
/// @throws InputError unless fps is in [1, 240]
Animation clip_of(const TrackedPoses& poses, const Skeleton& skeleton, const Similarity& normalisation, double fps,
                  const std::string& name);

}  // namespace anigen::tracking
