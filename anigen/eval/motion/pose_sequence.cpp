#include "anigen/eval/motion/pose_sequence.h"

#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/eval/skin/deformation.h"

namespace anigen::eval {
namespace {

using Turns = std::vector<Eigen::Quaterniond>;

/// Local rotations: the bind pose, then the poses.
std::vector<Turns> key_poses(std::size_t joints, std::uint64_t seed, const std::string& asset) {
  DeformationOptions options;
  options.seed = stable_hash(asset, seed);
  std::vector<Turns> keys(1, Turns(joints, Eigen::Quaterniond::Identity()));
  for (int pose = 0; pose < kSequencePoses; ++pose) {
    Turns turns;
    for (const Eigen::Matrix3d& rotation : random_rotations(joints, options, pose)) turns.emplace_back(rotation);
    keys.push_back(std::move(turns));
  }
  return keys;
}

}  // namespace

Motion pose_sequence(const io::JointTree& tree, std::uint64_t seed, const std::string& asset, int frames) {
  check(tree, asset);
  if (frames < 1 || frames > 10000) throw InputError("", "frames of a motion", "must be in 1 … 10000");
  const std::vector<Turns> keys = key_poses(tree.size(), seed, asset);
  const std::vector<int> order = parents_first(tree);
  Motion motion;
  motion.name = "random poses";
  motion.joints = tree;
  for (int f = 0; f < frames; ++f) {
    MotionFrame frame;
    frame.time = static_cast<double>(keys.size()) * f / frames;
    const auto key = static_cast<std::size_t>(frame.time);
    const Turns &before = keys[key], &after = keys[(key + 1) % keys.size()];
    frame.turns.resize(tree.size());
    frame.shifts.assign(tree.size(), Eigen::Vector3d::Zero());
    for (const int j : order) {
      const Eigen::Quaterniond local = before[at(j)].slerp(frame.time - static_cast<double>(key), after[at(j)]);
      const int parent = tree.parents[at(j)];
      frame.turns[at(j)] = parent < 0 ? local : (frame.turns[at(parent)] * local).normalized();
    }
    motion.frames.push_back(std::move(frame));
  }
  return motion;
}

}  // namespace anigen::eval
