#pragma once
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/motions/limbs.h"
#include "anigen/motions/poser.h"

namespace anigen::motions {

struct MotionOptions {
  int frames = 0;       ///< key frames of a clip, the last one that closes the loop included; 0: by fps
  double fps = 30.0;    ///< key frames per second, for frames = 0
  double speed = 1.0;   ///< factor on how fast a motion runs
  bool travel = false;  ///< walk, run, swim, fly and slither go forward; else they stay in place
};

/// @throws InputError naming an option out of its range: 2 to 10,000 frames, 1 to 240 per second, 0.01 to 100 times as
/// fast
void check_options(const MotionOptions& options);

/// Times at which a foot stands.
struct FootContact {
  int leg = 0;               ///< of Body::limbs
  std::vector<bool> stands;  ///< [N] per key frame
};

/// A motion of a body, before it becomes a clip.
struct BodyMotion {
  std::string name;
  std::vector<double> times;                                  ///< [N] seconds from 0
  std::vector<JointMotions> poses;                            ///< [N]
  bool loops = true;                                          ///< the last pose is the first one, but for travel
  Eigen::Vector3d ground_velocity = Eigen::Vector3d::Zero();  ///< of the ground below a body that walks in place
  std::vector<FootContact> contacts;                          ///< of walks
};

/// A motion that is built in.
struct BuiltInMotion {
  const char* word;
  const char* purpose;  ///< for help
  const char* needs;    ///< parts that a body needs for it; empty: none
};

/// idle, walk, run, jump, swim, fly, slither, wave, wag, look, nod, dance, spin, sway.
const std::vector<BuiltInMotion>& built_in_motions();

/// True for a word of built_in_motions().
bool is_built_in(const std::string& word);

/// True for the words of motions that MotionOptions::travel moves: walk, run, swim, fly, slither.
bool can_travel(const std::string& word);

/// Words of the motions that a body can do, in the order of built_in_motions().
std::vector<std::string> motions_of(const Body& body);

/// A motion for a body. @throws InputError for another word, or one that the body cannot do: it names what is missing
/// and the motions that it can do; also for options out of range (frames 0 or 2 … 10000, fps in [1, 240], speed in
/// [0.01, 100])
BodyMotion make_motion(const Body& body, const std::string& word, const MotionOptions& options = {});

/// Arms straight aside, palms as they are; legs, trunk and head stay. One pose.
/// @throws InputError when there are no two arms
BodyMotion t_pose(const Body& body);

/// The idle clip of an asset: breathing with planted feet, a fish that keeps its place, a plant in light wind.
/// @throws InputError as figure_of()
Animation idle_clip(const Asset& asset, const MotionOptions& options = {});

/// A motion as a clip of the skeleton of the asset that the body was made from.
inline Animation to_clip(const BodyMotion& motion, const Skeleton& skeleton) {
  return to_clip(motion.name, motion.times, motion.poses, skeleton);
}

}  // namespace anigen::motions
