#include "anigen/eval/motion/motion.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

std::vector<Eigen::Matrix3d> matrices(const std::vector<Eigen::Quaterniond>& turns) {
  std::vector<Eigen::Matrix3d> result;
  for (const Eigen::Quaterniond& turn : turns) result.push_back(turn.toRotationMatrix());
  return result;
}

double first_key(const Animation& animation) {
  double first = std::numeric_limits<double>::infinity();
  for (const Channel& channel : animation.channels) {
    if (!channel.times.empty()) first = std::min(first, channel.times.front());
  }
  return std::min(first, animation.duration());
}

/// By singular values: a joint scales along its own axes, which are not the world's.
double scaling_of(const Eigen::Matrix3d& linear) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(linear);
  const Eigen::Vector3d scales = svd.singularValues();  // in falling order
  return std::max(std::abs(scales[0] - 1.0), std::abs(scales[2] - 1.0));
}

}  // namespace

Motion motion_of(const Animation& animation, const Skeleton& skeleton, int frames) {
  if (frames < 1 || frames > 10000) throw InputError("", "frames of a motion", "must be in 1 … 10000");
  Motion motion;
  motion.name = animation.name;
  motion.joints = io::joint_tree(skeleton);
  std::vector<Eigen::Matrix4d> from_bind;
  for (const Eigen::Matrix4d& bind : skeleton.bind) from_bind.emplace_back(bind.inverse());
  const std::vector<int> order = parents_first(motion.joints);
  const double first = first_key(animation), last = animation.duration();
  for (int f = 0; f < frames; ++f) {
    MotionFrame frame;
    frame.time = frames == 1 ? first : first + (last - first) * f / (frames - 1);
    const std::vector<Eigen::Matrix4d> world =
        forward_kinematics(skeleton.parents, sample(animation, skeleton, frame.time));
    for (std::size_t j = 0; j < world.size(); ++j) {
      const Eigen::Matrix4d since = world[j] * from_bind[j];
      frame.turns.push_back(decompose(since).rotation);
      motion.scaling = std::max(motion.scaling, scaling_of(since.topLeftCorner<3, 3>()));
    }
    const std::vector<RigidMotion> turned = rigid_motions(motion.joints, order, matrices(frame.turns));
    for (std::size_t j = 0; j < world.size(); ++j)
      frame.shifts.push_back(world[j].topRightCorner<3, 1>() - turned[j](motion.joints.positions[j]));
    motion.frames.push_back(std::move(frame));
    if (first == last) break;  // a single pose: more frames would repeat it at the same time
  }
  return motion;
}

std::vector<RigidMotion> rigid_motions(const io::JointTree& tree, const MotionFrame& frame) {
  std::vector<RigidMotion> result = rigid_motions(tree, parents_first(tree), matrices(frame.turns));
  for (std::size_t j = 0; j < result.size(); ++j) result[j].shift += frame.shifts[j];
  return result;
}

Motion transformed(const Similarity& similarity, Motion motion) {
  const Eigen::Quaterniond turn(similarity.rotation);
  motion.joints = transformed(similarity, std::move(motion.joints));
  for (MotionFrame& frame : motion.frames) {
    for (Eigen::Quaterniond& rotation : frame.turns) rotation = (turn * rotation * turn.conjugate()).normalized();
    for (Eigen::Vector3d& shift : frame.shifts) shift = similarity.scale * (similarity.rotation * shift);
  }
  return motion;
}

bool moves(const Motion& motion) {
  constexpr double kLeast = 1e-3;
  const double size = size_of(motion.joints);
  const MotionFrame& first = motion.frames.front();
  for (const MotionFrame& frame : motion.frames) {
    for (std::size_t j = 0; j < frame.turns.size(); ++j) {
      if (frame.turns[j].angularDistance(first.turns[j]) > kLeast) return true;
      if ((frame.shifts[j] - first.shifts[j]).norm() > kLeast * size) return true;
    }
  }
  return false;
}

double size_of(const io::JointTree& tree) {
  Box box;
  for (const Eigen::Vector3d& position : tree.positions) box.extend(position);
  const double size = box.longest_side();
  return size > 0.0 ? size : 1.0;
}

}  // namespace anigen::eval
