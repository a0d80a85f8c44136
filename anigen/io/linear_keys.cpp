#include "anigen/io/linear_keys.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "anigen/asset/skeleton.h"
#include "anigen/core/numeric.h"

namespace anigen::io {

namespace {

using Value = Eigen::Vector4d;

constexpr double kSplineTolerance = 2e-5, kEulerTolerance = 4e-5;
constexpr double kLeastInterval = 1e-3;

Eigen::Quaterniond quaternion_of(const Value& v) { return {v[3], v[0], v[1], v[2]}; }

/// Value of the only channel of an animation of one joint at a time, as sample() has it.
Value sampled(const Animation& animation, const Skeleton& joint, double time) {
  const Transform at_time = sample(animation, joint, time).front();
  const ChannelPath path = animation.channels.front().path;
  if (path == ChannelPath::kRotation) return at_time.rotation.coeffs();
  Value value = Value::Zero();
  value.head<3>() = path == ChannelPath::kTranslation ? at_time.translation : at_time.scale;
  return value;
}

/// Difference of two values: an angle of rotations, else the largest of numbers.
double difference(const Value& a, const Value& b, bool rotates) {
  if (!rotates) return (a - b).cwiseAbs().maxCoeff();
  return 2.0 * std::min((a - b).norm(), (a + b).norm());  // as small angles are
}

void append_key(double time, Value value, LinearKeys& keys) {
  if (!keys.times.empty() && !(time > keys.times.back())) return;
  if (keys.rotates) {
    value.normalize();
    if (!keys.values.empty() && keys.values.back().dot(value) < 0.0) value = -value;
  }
  keys.times.push_back(time);
  keys.values.push_back(value);
}

/// Appends the key at `to` after others where the line from `from` needs them.
void append_spline(const std::function<Value(double)>& spline, double from, double to, double tolerance,
                   LinearKeys& keys) {
  LinearKeys line;
  line.rotates = keys.rotates;
  append_key(from, spline(from), line);
  append_key(to, spline(to), line);
  const double middle = 0.5 * (from + to);
  double error = 0.0;
  for (const double part : {0.25, 0.5, 0.75}) {
    const double time = from + part * (to - from);
    error = std::max(error, difference(spline(time), line.value_at(time), keys.rotates));
  }
  if (error > tolerance && middle - from >= kLeastInterval) {
    append_spline(spline, from, middle, tolerance, keys);
    append_spline(spline, middle, to, tolerance, keys);
  } else {
    append_key(to, spline(to), keys);
  }
}

}  // namespace

Eigen::Vector4d LinearKeys::value_at(double time) const {
  if (time <= times.front()) return values.front();
  if (time >= times.back()) return values.back();
  const auto after = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), time) - times.begin());
  const double part = (time - times[after - 1]) / (times[after] - times[after - 1]);
  const Value &a = values[after - 1], &b = values[after];
  if (!rotates) return (1.0 - part) * a + part * b;
  return quaternion_of(a).slerp(part, quaternion_of(b)).normalized().coeffs();
}

LinearKeys linear_keys(const Channel& channel) {
  LinearKeys keys;
  keys.rotates = channel.path == ChannelPath::kRotation;
  Animation alone{"", {channel}};
  alone.channels.front().joint = 0;
  const Skeleton joint = skeleton_from_joints({Eigen::Vector3d::Zero()}, {-1});
  const auto value = [&](double time) { return sampled(alone, joint, time); };
  const std::vector<double>& times = channel.times;
  double range = 1.0;
  if (!keys.rotates) {
    Value low = value(times.front()), high = low;
    for (const double time : times) {
      low = low.cwiseMin(value(time));
      high = high.cwiseMax(value(time));
    }
    range = std::max((high - low).maxCoeff(), 1e-3 * high.cwiseAbs().maxCoeff());
  }
  append_key(times.front(), value(times.front()), keys);
  for (std::size_t k = 1; k < times.size(); ++k) {
    if (channel.interpolation == Interpolation::kCubicSpline) {
      append_spline(value, times[k - 1], times[k], kSplineTolerance * range, keys);
      continue;
    }
    if (channel.interpolation == Interpolation::kStep) {
      const Value before = value(times[k - 1]);
      append_key(times[k] - std::min(kStepRamp, 0.25 * (times[k] - times[k - 1])), before, keys);
    }
    append_key(times[k], value(times[k]), keys);
  }
  return keys;
}

Eigen::Vector3d euler_degrees(const Eigen::Matrix3d& r, const Eigen::Vector3d& near) {
  constexpr double kToDegrees = 180.0 / kPi;
  const double cosine = std::hypot(r(0, 0), r(1, 0));
  const auto unrolled = [&near](Eigen::Vector3d angles) {
    for (int k = 0; k < 3; ++k) angles[k] += 360.0 * std::round((near[k] - angles[k]) / 360.0);
    return angles;
  };
  const double y = kToDegrees * std::atan2(-r(2, 0), cosine);
  if (cosine < 1e-7) {
    // x and z turn about one axis: z stays, x takes the rest.
    const double z = near.z() / kToDegrees, sine = r(2, 0) < 0.0 ? 1.0 : -1.0;
    const double sum = std::atan2(-r(1, 2), r(1, 1));  // x − z for y = 90°, x + z for y = −90°
    return unrolled({kToDegrees * (sum + sine * z), y, near.z()});
  }
  const Eigen::Vector3d one =
      unrolled({kToDegrees * std::atan2(r(2, 1), r(2, 2)), y, kToDegrees * std::atan2(r(1, 0), r(0, 0))});
  const Eigen::Vector3d other = unrolled({one.x() + 180.0, 180.0 - y, one.z() + 180.0});
  return (other - near).squaredNorm() < (one - near).squaredNorm() ? other : one;
}

namespace {

Eigen::Quaterniond rotation_of(const Eigen::Vector3d& degrees) {
  const Eigen::Vector3d a = kPi / 180.0 * degrees;
  return Eigen::AngleAxisd(a.z(), Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(a.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(a.x(), Eigen::Vector3d::UnitX());
}

/// Appends the key at `to` after others where straight lines of angles from the last key need them.
void append_euler(const LinearKeys& keys, double to, EulerKeys& out) {
  const double from = out.times.back();
  const Eigen::Vector3d start = out.degrees.back();
  const auto angles_at = [&](double time, const Eigen::Vector3d& near) {
    return euler_degrees(quaternion_of(keys.value_at(time)).toRotationMatrix(), near);
  };
  const Eigen::Vector3d end = angles_at(to, start);
  double error = 0.0;
  for (const double part : {0.25, 0.5, 0.75}) {
    const Eigen::Quaterniond line = rotation_of((1.0 - part) * start + part * end);
    error = std::max(error, line.angularDistance(quaternion_of(keys.value_at(from + part * (to - from)))));
  }
  if (error > kEulerTolerance && to - from >= 2.0 * kLeastInterval) {
    append_euler(keys, 0.5 * (from + to), out);
    append_euler(keys, to, out);
    return;
  }
  out.times.push_back(to);
  out.degrees.push_back(end);
}

}  // namespace

EulerKeys euler_keys(const LinearKeys& keys) {
  EulerKeys out;
  for (std::size_t k = 0; k < keys.times.size(); ++k) {
    if (k > 0) {
      append_euler(keys, keys.times[k], out);
      continue;
    }
    out.times.push_back(keys.times[0]);
    out.degrees.push_back(euler_degrees(quaternion_of(keys.values[0]).toRotationMatrix()));
  }
  return out;
}

double frame_rate(const std::vector<Animation>& animations) {
  for (const double rate : {30.0, 24.0, 25.0, 60.0, 50.0, 48.0, 120.0, 100.0}) {
    bool fits = true;
    for (const Animation& animation : animations) {
      for (const Channel& channel : animation.channels) {
        for (const double time : channel.times) fits = fits && std::abs(time * rate - std::round(time * rate)) < 0.02;
      }
    }
    if (fits) return rate;
  }
  return 30.0;
}

}  // namespace anigen::io
