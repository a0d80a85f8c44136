#include "anigen/prepare/augment/random_pose.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace anigen::prepare {
namespace {

Eigen::Vector3d random_direction(Rng& rng) {
  const double z = rng.uniform(-1.0, 1.0), longitude = rng.uniform(0.0, 2.0 * EIGEN_PI);
  const double radius = std::sqrt(std::max(0.0, 1.0 - z * z));
  return {radius * std::cos(longitude), radius * std::sin(longitude), z};
}

}  // namespace

JointTurns draw_turns(std::size_t joints, double probability, double max_angle, bool include_root, Rng& rng) {
  JointTurns turns;
  turns.rotations.assign(joints, Eigen::Matrix3d::Identity());
  turns.angles.assign(joints, 0.0);
  for (std::size_t j = include_root ? 0 : 1; j < joints; ++j) {
    if (!rng.chance(probability)) continue;
    const Eigen::Vector3d axis = random_direction(rng);
    turns.angles[j] = rng.uniform(0.0, max_angle);
    turns.rotations[j] = Eigen::AngleAxisd(turns.angles[j], axis.normalized()).toRotationMatrix();
  }
  return turns;
}

std::vector<Eigen::Matrix4d> turned_joints(const Skeleton& skeleton, const JointTurns& turns) {
  const std::vector<Eigen::Vector3d> joints = skeleton.positions();
  std::vector<Eigen::Matrix3d> frames(joints.size());  // G_k
  std::vector<Eigen::Vector3d> places(joints.size());  // g_k
  std::vector<Eigen::Matrix4d> world(joints.size());
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const int parent = skeleton.parents[k];
    if (parent < 0) {
      frames[k] = turns.rotations[k];
      places[k] = joints[k];
    } else {
      const auto p = static_cast<std::size_t>(parent);
      frames[k] = frames[p] * turns.rotations[k];
      places[k] = places[p] + frames[p] * (joints[k] - joints[p]);
    }
    world[k] = skeleton.bind[k];
    world[k].topLeftCorner<3, 3>() = frames[k] * skeleton.bind[k].topLeftCorner<3, 3>();
    world[k].topRightCorner<3, 1>() = places[k];
  }
  return world;
}

}  // namespace anigen::prepare
