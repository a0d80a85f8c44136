#include "anigen/io/gltf/import_animations.h"

namespace anigen::io::gltf_import {
namespace {

// Applies `prefix` to a value, or to a tangent, which a translation does not move.
void apply(const FoldedTransform& prefix, ChannelPath path, bool is_tangent, double* value) {
  if (path == ChannelPath::kRotation) {
    Eigen::Map<Eigen::Vector4d> q(value);
    // Quaternion products are linear in q, so this holds for tangents and values that are not of unit length.
    const Eigen::Quaterniond product = prefix.rotation * Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
    q = product.coeffs();
    return;
  }
  Eigen::Map<Eigen::Vector3d> v(value);
  if (path == ChannelPath::kScale)
    v = prefix.scale * v;
  else
    v = Eigen::Vector3d(prefix.scale * (prefix.rotation * v) +
                        (is_tangent ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : prefix.translation));
}

Channel convert(const Track& track, int joint, const FoldedTransform& prefix) {
  Channel channel;
  channel.joint = joint;
  channel.path = track.path;
  channel.interpolation = track.interpolation;
  channel.times = track.times;
  channel.values = track.values;
  const std::size_t width = track.path == ChannelPath::kRotation ? 4 : 3;
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  for (std::size_t i = 0; i < channel.values.size() / width; ++i)
    apply(prefix, track.path, cubic && i % 3 != 1, channel.values.data() + i * width);
  return channel;
}

}  // namespace

std::vector<Animation> convert_animations(const std::vector<TrackSet>& animations, const Rig& rig, Notes& notes) {
  std::vector<Animation> result;
  for (const TrackSet& set : animations) {
    Animation animation;
    animation.name = set.name;
    for (const Track& track : set.tracks) {
      const int joint = rig.joint_of_node[static_cast<std::size_t>(track.node)];
      if (joint < 0) {
        notes.tally("dropped_channels", "animation channels of nodes that are not joints were dropped");
        continue;
      }
      animation.channels.push_back(convert(track, joint, rig.prefix[static_cast<std::size_t>(joint)]));
    }
    if (animation.channels.empty())
      notes.tally("empty_animation", "animations without channels on joints were left out");
    else
      result.push_back(std::move(animation));
  }
  return result;
}

}  // namespace anigen::io::gltf_import
