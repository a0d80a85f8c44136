#pragma once
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"

namespace anigen {

enum class Interpolation { kStep, kLinear, kCubicSpline };
enum class ChannelPath { kTranslation, kRotation, kScale };

/// Keyframes of one property of one joint, relative to its parent. `values` holds 3 (translation, scale) or
/// 4 (rotation: x, y, z, w) numbers per key; three times as many for kCubicSpline (in-tangent, value, out-tangent).
struct Channel {
  int joint = 0;
  ChannelPath path = ChannelPath::kTranslation;
  Interpolation interpolation = Interpolation::kLinear;
  std::vector<double> times;  ///< seconds, strictly increasing, ≥ 0
  std::vector<double> values;
};

struct Animation {
  std::string name;
  std::vector<Channel> channels;
  double duration() const;  ///< largest key time, seconds
};

/// The pose at time t (clamped to the keyed range per channel): rest pose with the channels applied; glTF 2.0
/// appendix C. Rotations are interpolated on the shorter arc and returned with unit length.
Pose sample(const Animation& animation, const Skeleton& skeleton, double t);

}  // namespace anigen
