#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/normalize.h"
#include "anigen/core/json.h"
#include "anigen/prepare/augment/pose_checks.h"

namespace anigen::prepare {

enum class PoseKind { kAnimation, kRandom };
std::string to_string(PoseKind kind);  ///< "animation", "random"

/// Where a posed variant came from, or why there is none.
struct Provenance {
  std::string source_id;
  std::uint64_t seed = 0;
  std::size_t k = 0;
  PoseKind kind = PoseKind::kRandom;
  std::string clip;            ///< name of the animation, for kAnimation; files leave it empty at times
  double time = 0.0;           ///< seconds into the clip
  double second_time = 0.0;    ///< seconds; the other end of a blend, `time` where there is none
  double blend = 0.0;          ///< 0: the pose at `time`; up to ½ towards the pose at `second_time`
  int attempt = 0;             ///< draws rejected before this one
  std::size_t turned = 0;      ///< joints whose orientation relative to the parent differs from the source's bind pose
  double largest_angle = 0.0;  ///< degrees, of those joints
  Similarity renormalization;  ///< variant = scale · posed + offset
  PoseMeasures measures;       ///< of the pose that was taken, or of the last one rejected
  std::vector<std::string> rejections;    ///< why the draws before failed, in order
  std::vector<std::string> unused_clips;  ///< "<name>: <reason>"
};

/// All of it, with measures rounded to six digits.
Json to_json(const Provenance& provenance);

}  // namespace anigen::prepare
