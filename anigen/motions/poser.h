#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/metrics/deformation.h"
#include "anigen/motions/limbs.h"

namespace anigen::motions {

/// One pose of all joints: what each does to the vertices that it moves, from the bind pose.
using JointMotions = std::vector<metrics::RigidMotion>;

/// Builds a pose of a body from the bind pose: turns of joints, travel, and feet by inverse kinematics. World frame.
class Poser {
 public:
  /// @param body must outlive this
  explicit Poser(const Body& body);

  const Body& body() const { return body_; }

  /// Turns a joint, and all that hangs on it, about axes of the bind pose; turns of one joint follow each other.
  void turn(int joint, const Eigen::Quaterniond& by);
  /// As above, by degrees about an axis of unit length.
  void turn(int joint, const Eigen::Vector3d& axis, double degrees);
  /// Moves everything.
  void shift(const Eigen::Vector3d& by) { shift_ += by; }

  /// Places the ankle of a leg and gives its foot an orientation; hip and knees follow from the pose of the trunk, so
  /// call it after everything else. A leg of one piece points at the place; a place out of reach is approached.
  /// @param ankle where the joint has to be @param foot turn of the foot since the bind pose, world axes
  void place_foot(const Limb& leg, const Eigen::Vector3d& ankle, const Eigen::Quaterniond& foot);

  /// Starts from a pose; of joints' places only that of the root is taken over.
  void set(const JointMotions& pose);
  /// Moves the ankle of a leg in the pose as it is: foot and knee keep the directions that they have.
  void move_foot(const Limb& leg, const Eigen::Vector3d& ankle);

  JointMotions motions() const;
  /// The turn that a joint has now, world axes.
  Eigen::Quaterniond world_turn(int joint) const;

 private:
  Eigen::Vector3d bind(int joint) const { return body_.figure.tree.positions[at_joint(joint)]; }
  static std::size_t at_joint(int joint) { return static_cast<std::size_t>(joint); }

  const Body& body_;
  std::vector<Eigen::Quaterniond> turns_;  // [J] since the bind pose, relative to the parent, bind axes
  Eigen::Vector3d shift_ = Eigen::Vector3d::Zero();
};

/// Longest distance of a leg's ankle from its hip; for a leg of one piece the only one.
double reach_of(const Body& body, const Limb& leg);

/// Poses as a clip of the skeleton whose bind pose they start from. What does not move has one key, and translations
/// that equal the rest pose none.
/// @param times [N] seconds, increasing @param poses [N], one motion per joint each
/// @throws InputError for poses that are not finite, or of another number of joints
Animation to_clip(const std::string& name, const std::vector<double>& times, const std::vector<JointMotions>& poses,
                  const Skeleton& skeleton);

/// A clip with what does not move reduced as in to_clip().
Animation without_constants(Animation animation, const Skeleton& skeleton);

}  // namespace anigen::motions
