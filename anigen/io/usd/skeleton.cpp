#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/io/linear_keys.h"
#include "anigen/io/usd/export.h"

namespace anigen::io::usd_export {

std::vector<std::string> joint_paths(const Skeleton& skeleton) {
  Identifiers identifiers;
  std::vector<std::string> paths;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const std::string name = identifiers.make(skeleton.names[j], "joint");
    const int parent = skeleton.parents[j];
    paths.push_back(parent < 0 ? name : paths[at(parent)] + "/" + name);
  }
  return paths;
}

namespace {

using Value = Eigen::Vector4d;

std::string quaternion_text(const Value& xyzw) {
  return tuple_text(Eigen::Vector4f(Value(xyzw[3], xyzw[0], xyzw[1], xyzw[2]).cast<float>()));
}

std::string vector_text(const Value& value) { return tuple_text(Eigen::Vector3f(value.head<3>().cast<float>())); }

Value rest_value(const Transform& rest, ChannelPath path) {
  Value value = Value::Zero();
  if (path == ChannelPath::kRotation) return rest.rotation.coeffs();
  value.head<3>() = path == ChannelPath::kTranslation ? rest.translation : rest.scale;
  return value;
}

/// A clip as a prim. @param paths [J] of the joints
void add_clip(const Asset& asset, const Animation& animation, const std::string& prim,
              const std::vector<std::string>& paths, double rate, Lines& lines) {
  std::map<std::pair<ChannelPath, std::size_t>, LinearKeys> keys;
  std::set<std::size_t> joints;
  for (const Channel& channel : animation.channels) {
    joints.insert(at(channel.joint));
    keys[{channel.path, at(channel.joint)}] = linear_keys(channel);
  }
  lines.open_behind("def SkelAnimation \"" + prim + "\"", '(');
  lines.add_name(animation.name);
  lines.close(')');
  lines.open("");
  lines.add("uniform token[] joints = " + array_text(joints, [&](std::size_t j) { return string_text(paths[j]); }));
  struct Property {
    ChannelPath path;
    const char* name;
  };
  for (const Property& property :
       {Property{ChannelPath::kTranslation, "float3[] translations"},
        Property{ChannelPath::kRotation, "quatf[] rotations"}, Property{ChannelPath::kScale, "half3[] scales"}}) {
    std::set<double> times;
    for (const auto& [which, one] : keys) {
      if (which.first == property.path) times.insert(one.times.begin(), one.times.end());
    }
    // One value for each joint: all of them, since the format has no pose with some.
    const auto pose_text = [&](double time) {
      return array_text(joints, [&](std::size_t j) {
        const auto found = keys.find({property.path, j});
        const Value value =
            found == keys.end() ? rest_value(asset.skeleton.rest[j], property.path) : found->second.value_at(time);
        return property.path == ChannelPath::kRotation ? quaternion_text(value) : vector_text(value);
      });
    };
    if (times.empty()) {
      lines.add(std::string(property.name) + " = " + pose_text(0.0));
      continue;
    }
    lines.open_behind(std::string(property.name) + ".timeSamples =", '{');
    for (const double time : times) lines.add(number_text(time * rate) + ": " + pose_text(time) + ",");
    lines.close();
  }
  lines.close();
}

}  // namespace

void add_skeleton(const Asset& asset, const std::string& root, Lines& lines) {
  const Skeleton& skeleton = asset.skeleton;
  const std::vector<std::string> paths = joint_paths(skeleton);
  Identifiers identifiers;
  for (const char* const taken : {kSkeletonPrim, kMeshPrim, kMaterialsPrim}) identifiers.make(taken, "prim");
  std::vector<std::string> clips;
  for (const Animation& animation : asset.animations) {
    if (!animation.channels.empty()) clips.push_back(identifiers.make(animation.name, "Animation"));
  }
  lines.open_behind(std::string("def Skeleton \"") + kSkeletonPrim + "\"", '(');
  lines.add("prepend apiSchemas = [\"SkelBindingAPI\"]");
  lines.close(')');
  lines.open("");
  const auto matrices = [](const auto& items, auto matrix) {
    return array_text(items, [&](const auto& item) { return matrix_text(matrix(item)); });
  };
  lines.add("uniform matrix4d[] bindTransforms = " +
            matrices(skeleton.bind, [](const Eigen::Matrix4d& bind) { return bind; }));
  lines.add("uniform token[] jointNames = " + array_text(skeleton.names, string_text));
  lines.add("uniform token[] joints = " + array_text(paths, string_text));
  lines.add("uniform matrix4d[] restTransforms = " +
            matrices(skeleton.rest, [](const Transform& rest) { return rest.matrix(); }));
  if (!clips.empty()) lines.add("rel skel:animationSource = <" + root + "/" + clips.front() + ">");
  lines.close();
  const double rate = frame_rate(asset.animations);
  std::size_t clip = 0;
  for (const Animation& animation : asset.animations) {
    if (!animation.channels.empty()) add_clip(asset, animation, clips[clip++], paths, rate, lines);
  }
}

}  // namespace anigen::io::usd_export
