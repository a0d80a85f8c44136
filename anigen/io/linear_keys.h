#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/animation.h"

namespace anigen::io {

/// Keys of one property of one joint for formats that only know straight lines between keys (rotations: the shorter
/// arc). A value is a vector in its first three numbers, or a unit quaternion (x, y, z, w); quaternions that follow
/// each other lie on the same side.
struct LinearKeys {
  std::vector<double> times;  ///< seconds, strictly increasing
  std::vector<Eigen::Vector4d> values;
  bool rotates = false;

  /// @pre there is a key; before the first and after the last one their value holds
  Eigen::Vector4d value_at(double time) const;
};

/// A step becomes a ramp of this length before the key that it leads to, seconds (a quarter of a shorter interval).
inline constexpr double kStepRamp = 1e-3;

/// A channel as such keys. Linear keys stay where they are. A step becomes a short ramp. A spline gets further keys
/// where straight lines leave it by more than 2e-5 (rotations: 2e-5 rad; other values: of what they range over), no
/// closer than 1/1000 s.
/// @pre validate() finds nothing wrong with the channel, and it has a key
LinearKeys linear_keys(const Channel& channel);

/// Euler angles of rotations, for formats that interpolate these.
struct EulerKeys {
  std::vector<double> times;             ///< seconds, strictly increasing
  std::vector<Eigen::Vector3d> degrees;  ///< R = Rz · Ry · Rx; no angle jumps from a key to the next
};

/// Keys stand where the rotation has them, and between them where straight lines of angles leave the arc by more than
/// 4e-5 rad. @pre keys.rotates
EulerKeys euler_keys(const LinearKeys& keys);

/// Angles (x, y, z) of R = Rz · Ry · Rx in degrees, those nearest to `near` of all that give R.
Eigen::Vector3d euler_degrees(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& near = Eigen::Vector3d::Zero());

/// The frame rate of a whole clip collection: the first of 30, 24, 25, 60, 50, 48, 120 and 100 per second on whose
/// frames all keys lie, else 30.
double frame_rate(const std::vector<Animation>& animations);

}  // namespace anigen::io
