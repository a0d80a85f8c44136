#include "anigen/eval/motion/retarget.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/align/normalization.h"
#include "anigen/eval/motion/motion_plan.h"

namespace anigen::eval {
namespace {

struct Share {
  std::size_t joint;
  double weight;
};
using Shares = std::vector<Share>;  ///< of one target joint; weights sum to 1

void check_plan(const Motion& source, const io::JointTree& target, const Eigen::MatrixXd& plan) {
  check(target, "target skeleton");
  const auto n = static_cast<Eigen::Index>(target.size()), m = static_cast<Eigen::Index>(source.joints.size());
  if (plan.rows() != n || plan.cols() != m) {
    throw InputError("", "transport plan",
                     std::to_string(plan.rows()) + " x " + std::to_string(plan.cols()) + " for " + std::to_string(n) +
                         " target and " + std::to_string(m) + " source joints");
  }
  if (!plan.allFinite() || plan.minCoeff() < 0.0)
    throw InputError("", "transport plan", "an entry is negative or not finite");
}

Shares shares_of(const Eigen::MatrixXd& plan, std::size_t joint) {
  const auto row = plan.row(static_cast<Eigen::Index>(joint));
  const double sum = row.sum();
  Shares shares;
  double kept = 0.0;
  for (Eigen::Index s = 0; s < plan.cols(); ++s) {
    // Compared without dividing, so that a row of zeros gives nothing.
    if (row[s] > 0.0 && row[s] >= kLeastShare * sum) {
      shares.push_back({static_cast<std::size_t>(s), row[s]});
      kept += row[s];
    }
  }
  if (shares.empty() && sum > 0.0) {  // more than ten sources, none with a tenth: the strongest
    Eigen::Index best = 0;
    row.maxCoeff(&best);
    shares.push_back({static_cast<std::size_t>(best), 1.0});
    kept = 1.0;
  }
  for (Share& share : shares) share.weight /= kept;
  return shares;
}

std::size_t nearest(const Eigen::Vector3d& place, const io::JointTree& tree) {
  std::size_t best = 0;
  for (std::size_t j = 1; j < tree.size(); ++j) {
    if ((tree.positions[j] - place).squaredNorm() < (tree.positions[best] - place).squaredNorm()) best = j;
  }
  return best;
}

/// Where every target joint takes its motion from; an empty list: from its parent.
std::vector<Shares> all_shares(const Motion& source, const io::JointTree& target, const Eigen::MatrixXd& plan) {
  std::vector<Shares> result;
  for (std::size_t j = 0; j < target.size(); ++j) {
    result.push_back(shares_of(plan, j));
    if (result[j].empty() && target.parents[j] < 0)
      result[j].push_back({nearest(target.positions[j], source.joints), 1.0});
  }
  return result;
}

Eigen::Quaterniond mean_turn(const MotionFrame& frame, const Shares& shares) {
  if (shares.size() == 1) return frame.turns[shares[0].joint];
  // Eigenvector of the largest eigenvalue of Σ w q qᵀ, in which q and −q are the same.
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Share& share : shares) {
    const Eigen::Vector4d q = frame.turns[share.joint].coeffs();
    sum += share.weight * q * q.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(sum);
  return Eigen::Quaterniond(Eigen::Vector4d(solver.eigenvectors().col(3))).normalized();
}

Eigen::Vector3d mean_shift(const MotionFrame& frame, const Shares& shares) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Share& share : shares) sum += share.weight * frame.shifts[share.joint];
  return sum;
}

void add_channel(Animation& animation, std::size_t joint, ChannelPath path, const std::vector<double>& times,
                 std::vector<double> values) {
  Channel channel;
  channel.joint = static_cast<int>(joint);
  channel.path = path;
  channel.times = times;
  channel.values = std::move(values);
  animation.channels.push_back(std::move(channel));
}

/// The pose relative to parents in which the joints have these world matrices.
Pose local_pose(const std::vector<int>& parents, const std::vector<Eigen::Matrix4d>& world) {
  Pose pose;
  for (std::size_t j = 0; j < world.size(); ++j)
    pose.push_back(decompose(parents[j] < 0 ? world[j] : Eigen::Matrix4d(world[at(parents[j])].inverse() * world[j])));
  return pose;
}

}  // namespace

Motion retarget(const Motion& source, const io::JointTree& target, const Eigen::MatrixXd& plan, double scale) {
  check_plan(source, target, plan);
  const std::vector<Shares> shares = all_shares(source, target, plan);
  const std::vector<int> order = parents_first(target);
  Motion result;
  result.name = source.name;
  result.joints = target;
  result.scaling = source.scaling;
  for (const MotionFrame& frame : source.frames) {
    MotionFrame moved;
    moved.time = frame.time;
    moved.turns.resize(target.size());
    moved.shifts.resize(target.size());
    for (const int j : order) {
      const int parent = target.parents[at(j)];
      const bool follows = shares[at(j)].empty();
      moved.turns[at(j)] = follows ? moved.turns[at(parent)] : mean_turn(frame, shares[at(j)]);
      moved.shifts[at(j)] =
          follows ? moved.shifts[at(parent)] : Eigen::Vector3d(scale * mean_shift(frame, shares[at(j)]));
    }
    result.frames.push_back(std::move(moved));
  }
  return result;
}

Motion retarget(const Motion& source, const io::JointTree& target) {
  return retarget(source, target, motion_plan(target, source.joints));
}

Motion retarget_freely(const Motion& source, const io::JointTree& target) {
  const Similarity from = normalization(source.joints.positions, NormalizationMode::kBoundingBox);
  const Similarity to = normalization(target.positions, NormalizationMode::kBoundingBox);
  const Eigen::MatrixXd plan = motion_plan(transformed(to, target), transformed(from, source.joints), kFarReach);
  Motion grounded = source;
  const Eigen::Vector3d start = source.frames.front().shifts[at(roots(source.joints).front())];
  for (MotionFrame& frame : grounded.frames) {
    for (Eigen::Vector3d& shift : frame.shifts) shift -= start;
  }
  return retarget(grounded, target, plan, from.scale / to.scale);
}

Animation to_animation(const Motion& motion, const Skeleton& skeleton) {
  const std::size_t count = skeleton.size();
  if (motion.joints.size() != count) {
    throw InputError("", "motion",
                     std::to_string(motion.joints.size()) + " joints for a skeleton of " + std::to_string(count));
  }
  const io::JointTree tree = io::joint_tree(skeleton);
  std::vector<double> times;
  std::vector<std::vector<double>> rotations(count), translations(count), scales(count);
  std::vector<bool> rescaled(count, false);
  for (const MotionFrame& frame : motion.frames) {
    const std::vector<RigidMotion> moved = rigid_motions(tree, frame);
    std::vector<Eigen::Matrix4d> world(skeleton.bind);
    for (std::size_t j = 0; j < count; ++j) {
      world[j].topLeftCorner<3, 3>() = moved[j].turn * skeleton.bind[j].topLeftCorner<3, 3>();
      world[j].topRightCorner<3, 1>() = moved[j](tree.positions[j]);
    }
    const Pose pose = local_pose(skeleton.parents, world);
    times.push_back(frame.time);
    for (std::size_t j = 0; j < count; ++j) {
      const Eigen::Quaterniond& q = pose[j].rotation;
      const Eigen::Vector3d &t = pose[j].translation, &s = pose[j].scale;
      rotations[j].insert(rotations[j].end(), {q.x(), q.y(), q.z(), q.w()});
      translations[j].insert(translations[j].end(), {t.x(), t.y(), t.z()});
      scales[j].insert(scales[j].end(), {s.x(), s.y(), s.z()});
      if ((s - skeleton.rest[j].scale).cwiseAbs().maxCoeff() > 1e-9) rescaled[j] = true;
    }
  }
  Animation animation;
  animation.name = motion.name;
  for (std::size_t j = 0; j < count; ++j) {
    add_channel(animation, j, ChannelPath::kRotation, times, std::move(rotations[j]));
    add_channel(animation, j, ChannelPath::kTranslation, times, std::move(translations[j]));
    if (rescaled[j]) add_channel(animation, j, ChannelPath::kScale, times, std::move(scales[j]));
  }
  return animation;
}

Animation retarget(const Animation& animation, const Skeleton& source, const Skeleton& target,
                   const Eigen::MatrixXd& plan, int frames, double scale) {
  return to_animation(retarget(motion_of(animation, source, frames), io::joint_tree(target), plan, scale), target);
}

}  // namespace anigen::eval
