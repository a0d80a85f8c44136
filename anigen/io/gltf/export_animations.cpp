#include "anigen/io/gltf/export_animations.h"

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/gltf/export_axes.h"

namespace anigen::io {
namespace {

// Keys of one channel in single precision, in the file's axes.
struct Keys {
  std::vector<float> times, values;
  Interpolation interpolation = Interpolation::kLinear;
};

// The numbers of all animations share one view; accessors follow once it is complete.
struct Pool {
  struct Part {
    std::size_t offset, count, width;
    bool bounds;
  };
  std::vector<float> numbers;
  std::vector<Part> parts;
  std::map<std::vector<float>, std::size_t> known_times;  // exporters of animations repeat one time line per joint

  std::size_t add(const std::vector<float>& values, std::size_t width, bool bounds) {
    parts.push_back({numbers.size(), values.size() / width, width, bounds});
    numbers.insert(numbers.end(), values.begin(), values.end());
    return parts.size() - 1;
  }
  std::size_t add_times(const std::vector<float>& times) {
    const auto known = known_times.find(times);
    return known != known_times.end() ? known->second : known_times[times] = add(times, 1, true);
  }
};

const char* path_name(ChannelPath path) {
  switch (path) {
    case ChannelPath::kTranslation:
      return "translation";
    case ChannelPath::kRotation:
      return "rotation";
    default:
      return "scale";
  }
}

const char* interpolation_name(Interpolation interpolation) {
  switch (interpolation) {
    case Interpolation::kStep:
      return "STEP";
    case Interpolation::kLinear:
      return "LINEAR";
    default:
      return "CUBICSPLINE";
  }
}

[[noreturn]] void reject(const std::string& file, const Channel& channel, const std::string& problem) {
  throw InputError(
      file, std::string("animation channel ") + path_name(channel.path) + " of joint " + std::to_string(channel.joint),
      problem);
}

// Turns the root's vectors into the file's axes, one element (key value or tangent) at a time.
void turn_root(const Channel& channel, ExportAxes axes, double* value) {
  if (channel.path == ChannelPath::kTranslation) {
    Eigen::Map<Eigen::Vector3d> v(value);
    v = (axis_rotation(axes) * v).eval();
  } else if (channel.path == ChannelPath::kRotation) {
    const Eigen::Quaterniond q = axis_quaternion(axes) * Eigen::Quaterniond(value[3], value[0], value[1], value[2]);
    value[0] = q.x(), value[1] = q.y(), value[2] = q.z(), value[3] = q.w();
  }
}

Keys convert(const Channel& channel, bool is_root, ExportAxes axes, const std::string& file) {
  const std::size_t width = channel.path == ChannelPath::kRotation ? 4 : 3;
  const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
  const std::size_t per_key = width * (cubic ? 3 : 1);
  const std::size_t value_at = cubic ? width : 0;
  Keys keys;
  keys.interpolation = channel.interpolation;
  for (std::size_t k = 0; k < channel.times.size(); ++k) {
    std::vector<double> key(channel.values.begin() + static_cast<std::ptrdiff_t>(k * per_key),
                            channel.values.begin() + static_cast<std::ptrdiff_t>((k + 1) * per_key));
    if (is_root) {
      for (std::size_t i = 0; i < per_key; i += width) turn_root(channel, axes, key.data() + i);
    }
    if (channel.path == ChannelPath::kRotation) {
      const double length = Eigen::Map<Eigen::Vector4d>(key.data() + value_at).norm();
      if (!(length > 1e-12)) reject(file, channel, "key " + std::to_string(k) + " is a rotation of length zero");
      for (double& x : key) x /= length;
    }
    const float time = static_cast<float>(channel.times[k]);
    std::size_t keep = 0;
    if (!keys.times.empty() && time <= keys.times.back()) {
      // The merged key arrives with the tangent of the earlier and leaves with that of the later one.
      keep = value_at;
      keys.values.resize(keys.values.size() - per_key + keep);
    } else {
      keys.times.push_back(time);
    }
    for (std::size_t i = keep; i < per_key; ++i) keys.values.push_back(static_cast<float>(key[i]) + 0.0f);
  }
  for (const std::vector<float>* numbers : {&keys.times, &keys.values}) {
    for (const float x : *numbers) {
      if (!std::isfinite(x)) reject(file, channel, "a number exceeds single precision");
    }
  }
  if (cubic && keys.times.size() == 1) {  // the format wants two keys for a spline; one key is a constant
    keys.interpolation = Interpolation::kStep;
    keys.values = {keys.values.begin() + static_cast<std::ptrdiff_t>(value_at),
                   keys.values.begin() + static_cast<std::ptrdiff_t>(value_at + width)};
  }
  return keys;
}

// Samplers refer to parts of the pool here; write_animations() replaces them by accessors.
Json animation_json(const Animation& animation, const Asset& asset, ExportAxes axes, const std::string& file,
                    Pool& pool) {
  std::map<std::pair<int, ChannelPath>, const Channel*> last;
  for (const Channel& channel : animation.channels) last[{channel.joint, channel.path}] = &channel;
  Json channels = Json::array(), samplers = Json::array();
  for (const Channel& channel : animation.channels) {
    if (channel.times.empty() || last[{channel.joint, channel.path}] != &channel) continue;
    const bool is_root = asset.skeleton.parents[static_cast<std::size_t>(channel.joint)] < 0;
    const Keys keys = convert(channel, is_root, axes, file);
    const std::size_t input = pool.add_times(keys.times);
    const std::size_t output = pool.add(keys.values, channel.path == ChannelPath::kRotation ? 4 : 3, false);
    channels.push_back(
        {{"sampler", samplers.size()}, {"target", {{"node", channel.joint}, {"path", path_name(channel.path)}}}});
    samplers.push_back(
        {{"input", input}, {"interpolation", interpolation_name(keys.interpolation)}, {"output", output}});
  }
  Json entry = Json::object();
  if (!animation.name.empty()) entry["name"] = animation.name;
  entry["channels"] = std::move(channels);
  entry["samplers"] = std::move(samplers);
  return entry;
}

}  // namespace

void write_animations(GltfDocument& document, const Asset& asset, ExportAxes axes, const std::string& file) {
  Pool pool;
  Json animations = Json::array();
  for (const Animation& animation : asset.animations) {
    Json entry = animation_json(animation, asset, axes, file, pool);
    if (!entry["channels"].empty()) animations.push_back(std::move(entry));
  }
  if (animations.empty()) return;
  const int view = document.add_view(pool.numbers.data(), pool.numbers.size() * sizeof(float), ViewTarget::kNone);
  std::vector<int> accessors;
  for (const Pool::Part& part : pool.parts) {
    accessors.push_back(document.add_accessor(view, part.offset * sizeof(float), ComponentType::kFloat,
                                              accessor_type(part.width), part.count));
    if (part.bounds) {
      const auto begin = pool.numbers.begin() + static_cast<std::ptrdiff_t>(part.offset);
      document.set_bounds(accessors.back(), {begin, begin + static_cast<std::ptrdiff_t>(part.count * part.width)},
                          part.width);
    }
  }
  for (Json& animation : animations) {
    for (Json& sampler : animation["samplers"]) {
      sampler["input"] = accessors[sampler["input"].get<std::size_t>()];
      sampler["output"] = accessors[sampler["output"].get<std::size_t>()];
    }
  }
  document.json["animations"] = std::move(animations);
}

}  // namespace anigen::io
