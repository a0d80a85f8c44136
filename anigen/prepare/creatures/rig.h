#pragma once
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/prepare/creatures/body.h"

namespace anigen::prepare {

/// How the joints of a body are written down: their order and the orientation of their frames, which differ between
/// real files as much as between two of these.
struct RigStyle {
  enum class Frames { kWorld, kBoneAlongY, kBoneAlongX };
  Frames frames = Frames::kWorld;          ///< joint axes parallel to the world's, or one of them along the bone
  std::vector<int> order;                  ///< body joint of every skeleton joint; parents before children
  std::vector<int> position;               ///< the inverse of `order`
  std::vector<Eigen::Vector3d> placement;  ///< per body joint: how far from the exact centre a hand would have put it
};

RigStyle random_style(const Body& body, Rng& rng);

/// The posed body's joints as a skeleton whose rest pose is its bind pose.
Skeleton make_skeleton(const Body& body, const RigStyle& style);

/// The body's swings as a loop of 1 to 2 s: keyed, linearly interpolated rotations.
Animation make_idle_animation(const Body& body, const Skeleton& skeleton, const RigStyle& style, Rng& rng);

}  // namespace anigen::prepare
