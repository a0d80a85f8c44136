#include "anigen/asset/animation.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen {

namespace {

using Value = Eigen::Vector4d;  // a quaternion (x, y, z, w), or a vector in the first three

Value key(const Channel& channel, std::size_t index, std::size_t width, std::size_t part) {
  const std::size_t parts = channel.interpolation == Interpolation::kCubicSpline ? 3 : 1;
  const double* source = channel.values.data() + (index * parts + part) * width;
  Value value = Value::Zero();
  for (std::size_t i = 0; i < width; ++i) value[static_cast<Eigen::Index>(i)] = source[i];
  return value;
}

Value slerp(const Value& a, Value b, double s) {
  double cosine = a.dot(b);
  if (cosine < 0.0) {  // the shorter of the two arcs
    b = -b;
    cosine = -cosine;
  }
  if (cosine > 1.0 - 1e-9) return ((1.0 - s) * a + s * b).normalized();
  const double angle = std::acos(std::min(1.0, cosine));
  return (std::sin((1.0 - s) * angle) * a + std::sin(s * angle) * b) / std::sin(angle);
}

Value interpolate(const Channel& channel, double t) {
  const bool rotation = channel.path == ChannelPath::kRotation;
  const std::size_t width = rotation ? 4 : 3;
  const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
  const std::size_t middle = cubic ? 1 : 0;
  const std::vector<double>& times = channel.times;
  if (!(t > times.front())) return key(channel, 0, width, middle);
  if (t >= times.back()) return key(channel, times.size() - 1, width, middle);
  const auto after = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), t) - times.begin());
  const std::size_t before = after - 1;
  const double span = times[after] - times[before];
  const double s = (t - times[before]) / span;
  const Value a = key(channel, before, width, middle), b = key(channel, after, width, middle);
  if (channel.interpolation == Interpolation::kStep) return a;
  if (!cubic) return rotation ? slerp(a.normalized(), b.normalized(), s) : Value((1.0 - s) * a + s * b);
  const Value out_tangent = span * key(channel, before, width, 2), in_tangent = span * key(channel, after, width, 0);
  const double s2 = s * s, s3 = s2 * s;
  return (2 * s3 - 3 * s2 + 1) * a + (s3 - 2 * s2 + s) * out_tangent + (-2 * s3 + 3 * s2) * b + (s3 - s2) * in_tangent;
}

}  // namespace

double Animation::duration() const {
  double last = 0.0;
  for (const Channel& channel : channels) {
    if (!channel.times.empty()) last = std::max(last, channel.times.back());
  }
  return last;
}

Pose sample(const Animation& animation, const Skeleton& skeleton, double t) {
  Pose pose = skeleton.rest;
  for (const Channel& channel : animation.channels) {
    if (channel.times.empty()) continue;
    const Value value = interpolate(channel, t);
    Transform& joint = pose[at(channel.joint)];
    if (channel.path == ChannelPath::kTranslation) joint.translation = value.head<3>();
    if (channel.path == ChannelPath::kScale) joint.scale = value.head<3>();
    // A spline can pass through zero between opposite keys: the rest rotation then stands.
    if (channel.path == ChannelPath::kRotation && value.norm() > 1e-12)
      joint.rotation = Eigen::Quaterniond(value[3], value[0], value[1], value[2]).normalized();
  }
  return pose;
}

}  // namespace anigen
