#include "anigen/io/gltf/animations.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "anigen/core/error.h"
#include "anigen/io/gltf/accessors.h"

namespace anigen::io::gltf_import {

namespace {

// Many channels can point at one accessor, so the file's size does not bound this.
constexpr std::size_t kMostValues = 50'000'000;

std::size_t width_of(ChannelPath path) { return path == ChannelPath::kRotation ? 4 : 3; }

// True when one key's values can be used; a LINEAR or STEP rotation is given unit length.
bool repair_values(const Track& track, double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  if (track.path != ChannelPath::kRotation) return true;
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  Eigen::Map<Eigen::Vector4d> rotation(values + (cubic ? 4 : 0));
  const double norm = rotation.norm();
  if (!(norm > 1e-9) || !std::isfinite(norm)) return false;
  // A spline's tangents belong to the values as they are.
  if (!cubic) rotation /= norm;
  return true;
}

Track read_track(const Document& document, const AnimationChannel& channel, std::size_t& dropped) {
  Track track;
  track.node = channel.node;
  track.path = channel.path;
  track.interpolation = channel.interpolation;
  const std::vector<double> times = read_doubles(document, channel.input);
  std::vector<double> values = read_doubles(document, channel.output);
  const std::size_t width = width_of(track.path) * (track.interpolation == Interpolation::kCubicSpline ? 3 : 1);
  for (std::size_t k = 0; k < times.size(); ++k) {
    const bool in_order =
        std::isfinite(times[k]) && times[k] >= 0.0 && (track.times.empty() || times[k] > track.times.back());
    double* key = values.data() + k * width;
    if (!in_order || !repair_values(track, key, width)) {
      ++dropped;
      continue;
    }
    track.times.push_back(times[k]);
    track.values.insert(track.values.end(), key, key + width);
  }
  return track;
}

bool is_constant_rest(const Track& track, const Transform& rest) {
  Eigen::Vector4d expected = Eigen::Vector4d::Zero();
  if (track.path == ChannelPath::kTranslation) expected.head<3>() = rest.translation;
  if (track.path == ChannelPath::kScale) expected.head<3>() = rest.scale;
  if (track.path == ChannelPath::kRotation) expected = rest.rotation.coeffs();
  const std::size_t width = width_of(track.path);
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  // Float noise of an exporter, relative to the size of what is keyed.
  const double tolerance = 1e-5 * std::max(expected.norm(), 1e-3);
  for (std::size_t k = 0; k < track.times.size(); ++k) {
    const double* key = track.values.data() + k * width * (cubic ? 3 : 1);
    double plus = 0.0, minus = 0.0;
    for (std::size_t i = 0; i < width; ++i) {
      const double value = key[(cubic ? width : 0) + i];
      const double wanted = expected[static_cast<Eigen::Index>(i)];
      plus = std::max(plus, std::abs(value - wanted));
      minus = std::max(minus, std::abs(value + wanted));
      if (cubic && (std::abs(key[i]) > tolerance || std::abs(key[2 * width + i]) > tolerance)) return false;
    }
    // q and -q are the same rotation.
    if (plus > tolerance && (track.path != ChannelPath::kRotation || minus > tolerance)) return false;
  }
  return true;
}

}  // namespace

std::vector<TrackSet> read_tracks(const Document& document, Notes& notes) {
  std::vector<TrackSet> result;
  std::size_t values = 0, dropped = 0;
  for (const AnimationEntry& animation : document.animations) {
    TrackSet set;
    set.name = animation.name.empty() ? "animation_" + std::to_string(result.size()) : animation.name;
    std::set<std::pair<int, int>> seen;
    for (const AnimationChannel& channel : animation.channels) {
      if (!seen.emplace(channel.node, static_cast<int>(channel.path)).second) {
        notes.tally("dropped_channels", "animation channels repeated a property and were dropped");
        continue;
      }
      const Accessor& output = document.accessors[static_cast<std::size_t>(channel.output)];
      values += output.count * output.width;
      if (values > kMostValues) {
        throw InputError(document.file, channel.pointer,
                         "the animations have more than " + std::to_string(kMostValues) + " values");
      }
      Track track = read_track(document, channel, dropped);
      if (!track.times.empty()) set.tracks.push_back(std::move(track));
    }
    result.push_back(std::move(set));
  }
  notes.tally("repaired_keyframes", "keyframes with unusable times or values were dropped", dropped);
  return result;
}

std::vector<NodeClip> clips_of_nodes(const std::vector<TrackSet>& animations) {
  std::vector<NodeClip> clips;
  for (const TrackSet& set : animations) {
    NodeClip clip{set.name, 0.0, set.tracks.size()};
    for (const Track& track : set.tracks) clip.seconds = std::max(clip.seconds, track.times.back());
    if (clip.tracks > 0) clips.push_back(std::move(clip));
  }
  return clips;
}

std::vector<char> moving_nodes(const Document& document, const std::vector<TrackSet>& animations) {
  std::vector<char> moving(document.nodes.size(), 0);
  for (const TrackSet& animation : animations) {
    for (const Track& track : animation.tracks) {
      const auto node = static_cast<std::size_t>(track.node);
      if (moving[node] == 0 && !is_constant_rest(track, document.nodes[node].local)) moving[node] = 1;
    }
  }
  return moving;
}

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
