#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/io/fbx/export.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/linear_keys.h"

namespace anigen::io::fbx_export {

namespace {

/// One animated vector of a joint: what a curve node holds.
struct Curves {
  const char *node, *property;  ///< "T", "Lcl Translation"
  std::vector<double> times;
  std::vector<Eigen::Vector3d> values;
};

Curves curves_of(const Channel& channel) {
  LinearKeys keys = linear_keys(channel);
  if (channel.path == ChannelPath::kRotation) {
    EulerKeys angles = euler_keys(keys);
    return {"R", "Lcl Rotation", std::move(angles.times), std::move(angles.degrees)};
  }
  const bool moves = channel.path == ChannelPath::kTranslation;
  Curves curves{moves ? "T" : "S", moves ? "Lcl Translation" : "Lcl Scaling", std::move(keys.times), {}};
  for (const Eigen::Vector4d& value : keys.values) curves.values.push_back(value.head<3>());
  return curves;
}

void add_curve(const Curves& curves, int axis, std::int64_t curve_node, Scene& scene) {
  constexpr int kKeyVersion = 4009, kLinear = 4;
  constexpr float kDefaultWeights = 9.41996e-30f;  // two tangent weights of a third as 16-bit numbers
  std::vector<std::int64_t> times;
  std::vector<float> values;
  for (std::size_t k = 0; k < curves.times.size(); ++k) {
    times.push_back(ticks(curves.times[k]));
    values.push_back(static_cast<float>(curves.values[k][axis]));
  }
  std::int64_t id = 0;
  Record& curve = scene.object("AnimationCurve", "", "AnimCurve", "", id);
  curve.child("Default").real(curves.values.front()[axis]);
  curve.child("KeyVer").int32(kKeyVersion);
  curve.child("KeyTime").array(times);
  curve.child("KeyValueFloat").array(values);
  curve.child("KeyAttrFlags").array(std::vector<std::int32_t>{kLinear});
  curve.child("KeyAttrDataFloat").array(std::vector<float>{0.0f, 0.0f, kDefaultWeights, 0.0f});
  curve.child("KeyAttrRefCount").array(std::vector<std::int32_t>{static_cast<std::int32_t>(times.size())});
  const char* const names[] = {"d|X", "d|Y", "d|Z"};
  scene.connect(id, curve_node, names[axis]);
}

using Property = std::pair<int, ChannelPath>;  // of a joint

std::set<Property> animated_properties(const std::vector<Animation>& animations) {
  std::set<Property> properties;
  for (const Animation& animation : animations) {
    for (const Channel& channel : animation.channels) properties.emplace(channel.joint, channel.path);
  }
  return properties;
}

/// The rest pose's value at the start.
Channel resting(const Property& property, const Skeleton& skeleton) {
  const Transform& rest = skeleton.rest[at(property.first)];
  Channel channel{property.first, property.second, Interpolation::kLinear, {0.0}, {}};
  const auto set = [&channel](const auto& numbers) {
    channel.values.assign(numbers.data(), numbers.data() + numbers.size());
  };
  if (property.second == ChannelPath::kTranslation) set(rest.translation);
  if (property.second == ChannelPath::kRotation) set(rest.rotation.coeffs());
  if (property.second == ChannelPath::kScale) set(rest.scale);
  return channel;
}

}  // namespace

std::vector<std::string> clip_names(const Asset& asset) {
  std::vector<std::string> names;
  for (const Animation& animation : asset.animations)
    names.push_back(unused_name(animation.name.empty() ? "animation" : animation.name, names));
  return names;
}

void add_clips(const Asset& asset, const std::vector<std::int64_t>& joints, Scene& scene) {
  const std::vector<std::string> names = clip_names(asset);
  const std::set<Property> animated = animated_properties(asset.animations);
  for (std::size_t a = 0; a < asset.animations.size(); ++a) {
    const Animation& animation = asset.animations[a];
    std::int64_t stack = 0, layer = 0;
    Record& properties =
        scene.object("AnimationStack", names[a], "AnimStack", "", stack).always_a_list().child("Properties70");
    for (const char* const start : {"LocalStart", "ReferenceStart"}) set_time(properties, start, 0.0);
    for (const char* const stop : {"LocalStop", "ReferenceStop"}) set_time(properties, stop, animation.duration());
    scene.object("AnimationLayer", names[a], "AnimLayer", "", layer).always_a_list();
    scene.connect(layer, stack);
    std::vector<Channel> channels = animation.channels;
    std::set<Property> missing = animated;
    for (const Channel& channel : channels) missing.erase({channel.joint, channel.path});
    for (const Property& property : missing) channels.push_back(resting(property, asset.skeleton));
    for (const Channel& channel : channels) {
      const Curves curves = curves_of(channel);
      std::int64_t node = 0;
      Record& values = scene.object("AnimationCurveNode", curves.node, "AnimCurveNode", "", node).child("Properties70");
      const char* const axes[] = {"d|X", "d|Y", "d|Z"};
      for (int axis = 0; axis < 3; ++axis) {
        const double value = curves.values.front()[axis];
        values.child("P").text(axes[axis]).text("Number").text("").text("A").real(value);
      }
      scene.connect(node, layer);
      scene.connect(node, joints[at(channel.joint)], curves.property);
      for (int axis = 0; axis < 3; ++axis) add_curve(curves, axis, node, scene);
    }
  }
}

}  // namespace anigen::io::fbx_export
