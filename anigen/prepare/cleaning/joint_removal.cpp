#include "anigen/prepare/cleaning/joint_removal.h"

#include <Eigen/LU>
#include <algorithm>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::prepare {
namespace {

using Eigen::Matrix4d;

/// Where everything goes.
struct Plan {
  std::vector<int> kept;     ///< old numbers in the new order, parents first
  std::vector<int> number;   ///< [J] new number, -1 for a removed joint
  std::vector<int> parents;  ///< [kept] new numbers
  std::vector<char> moved;   ///< [kept] hangs on another joint than before
};

Plan make_plan(const Skeleton& skeleton, const std::vector<int>& heir) {
  const std::size_t joints = skeleton.size();
  std::vector<int> tops, above(joints, -1);
  std::vector<std::size_t> stay;
  if (heir.size() != joints) throw Error("remove_joints: one heir per joint");
  for (std::size_t j = 0; j < joints; ++j) {
    const int h = heir[j];
    const bool stays = h == static_cast<int>(j);
    if (!stays && (h < -1 || h > static_cast<int>(j) || (h >= 0 && heir[at(h)] != h)))
      throw Error("remove_joints: joint " + std::to_string(j) + " has no heir that stays");
    if (!stays) continue;
    stay.push_back(j);
    const int parent = skeleton.parents[j];
    above[j] = parent < 0 ? -1 : heir[at(parent)];
    if (above[j] < 0) tops.push_back(static_cast<int>(j));
  }
  if (tops.empty()) throw Error("remove_joints: not one joint stays");

  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int top : tops) mean += positions[at(top)] / static_cast<double>(tops.size());
  const int root = *std::min_element(tops.begin(), tops.end(), [&](int a, int b) {
    return (positions[at(a)] - mean).squaredNorm() < (positions[at(b)] - mean).squaredNorm();
  });
  Plan plan;
  plan.number.assign(joints, -1);
  plan.kept.push_back(root);
  for (const std::size_t j : stay) {
    if (static_cast<int>(j) != root) plan.kept.push_back(static_cast<int>(j));
  }
  for (std::size_t n = 0; n < plan.kept.size(); ++n) plan.number[at(plan.kept[n])] = static_cast<int>(n);
  for (const int j : plan.kept) {
    const int parent = above[at(j)] >= 0 ? above[at(j)] : j == root ? -1 : root;
    plan.parents.push_back(parent < 0 ? -1 : plan.number[at(parent)]);
    plan.moved.push_back(parent != skeleton.parents[at(j)] ? 1 : 0);
  }
  return plan;
}

/// Relative to the new parent. A joint can rest at scale 0, under which nothing has a place: then it stays at its own.
Transform local_of(const Matrix4d* parent, const Matrix4d& world, const Transform& otherwise) {
  const Matrix4d local = parent == nullptr ? world : Matrix4d(parent->inverse() * world);
  if (!local.allFinite()) return otherwise;
  const Transform result = decompose(local);
  return result.translation.allFinite() && result.scale.allFinite() ? result : otherwise;
}

/// The joint and everything above it in the old tree.
void add_chain(const Skeleton& skeleton, int joint, std::set<int>& chain) {
  for (; joint >= 0 && chain.insert(joint).second; joint = skeleton.parents[at(joint)]) {
  }
}

Animation moved_animation(const Animation& animation, const Skeleton& skeleton, const Plan& plan) {
  Animation result;
  result.name = animation.name;
  std::vector<std::vector<const Channel*>> channels(skeleton.size());
  for (const Channel& channel : animation.channels) {
    channels[at(channel.joint)].push_back(&channel);
    const int number = plan.number[at(channel.joint)];
    if (number < 0 || plan.moved[at(number)] != 0) continue;
    result.channels.push_back(channel);
    result.channels.back().joint = number;
  }
  // Times at which each joint that hangs elsewhere needs keys: whatever moves it or its new parent on its own.
  std::vector<std::set<double>> times(plan.kept.size());
  std::vector<char> is_step(plan.kept.size(), 1);
  std::set<double> all_times;
  for (std::size_t n = 0; n < plan.kept.size(); ++n) {
    if (plan.moved[n] == 0) continue;
    std::set<int> chain, shared;
    add_chain(skeleton, plan.kept[n], chain);
    if (plan.parents[n] >= 0) add_chain(skeleton, plan.kept[at(plan.parents[n])], shared);
    for (const auto* some : {&chain, &shared}) {
      for (const int joint : *some) {
        const bool in_both = chain.count(joint) > 0 && shared.count(joint) > 0;
        if (in_both) continue;
        for (const Channel* channel : channels[at(joint)]) {
          times[n].insert(channel->times.begin(), channel->times.end());
          if (channel->interpolation != Interpolation::kStep) is_step[n] = 0;
        }
      }
    }
    all_times.insert(times[n].begin(), times[n].end());
  }
  std::vector<std::vector<Channel>> made(plan.kept.size());
  for (const double t : all_times) {
    const Pose pose = sample(animation, skeleton, t);
    const std::vector<Matrix4d> world = forward_kinematics(skeleton.parents, pose);
    for (std::size_t n = 0; n < plan.kept.size(); ++n) {
      if (times[n].count(t) == 0) continue;
      if (made[n].empty()) {
        for (const ChannelPath path : {ChannelPath::kTranslation, ChannelPath::kRotation, ChannelPath::kScale}) {
          Channel channel;
          channel.joint = static_cast<int>(n);
          channel.path = path;
          channel.interpolation = is_step[n] != 0 ? Interpolation::kStep : Interpolation::kLinear;
          made[n].push_back(std::move(channel));
        }
      }
      const int parent = plan.parents[n];
      const Transform local = local_of(parent < 0 ? nullptr : &world[at(plan.kept[at(parent)])],
                                       world[at(plan.kept[n])], pose[at(plan.kept[n])]);
      for (Channel& channel : made[n]) channel.times.push_back(t);
      const auto append = [](Channel& channel, const double* values, std::ptrdiff_t count) {
        channel.values.insert(channel.values.end(), values, values + count);
      };
      append(made[n][0], local.translation.data(), 3);
      append(made[n][1], local.rotation.coeffs().data(), 4);
      append(made[n][2], local.scale.data(), 3);
    }
  }
  for (std::vector<Channel>& some : made) {
    for (Channel& channel : some) result.channels.push_back(std::move(channel));
  }
  return result;
}

SkinWeights moved_weights(const SkinWeights& skin, const std::vector<int>& heir, const Plan& plan) {
  SkinWeights result;
  std::vector<Influence> row;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    row.assign(skin.row(v), skin.row(v) + skin.row_size(v));
    for (Influence& influence : row) {
      const int taker = heir[at(influence.joint)];
      if (taker < 0) throw Error("remove_joints: a joint with weights has no heir");
      influence.joint = plan.number[at(taker)];
    }
    result.append_row(row);
  }
  return result;
}

}  // namespace

std::vector<char> weighted_joints(const Asset& asset) {
  std::vector<char> weighted(asset.skeleton.size(), 0);
  for (const Influence& influence : asset.skin.influences) weighted[at(influence.joint)] = 1;
  return weighted;
}

void remove_joints(Asset& asset, const std::vector<int>& heir) {
  const Skeleton& old = asset.skeleton;
  const Plan plan = make_plan(old, heir);
  if (plan.kept.size() == old.size()) return;
  asset.skin = moved_weights(asset.skin, heir, plan);
  std::vector<Animation> animations;
  for (const Animation& animation : asset.animations) {
    Animation moved = moved_animation(animation, old, plan);
    if (!moved.channels.empty()) animations.push_back(std::move(moved));
  }
  asset.animations = std::move(animations);
  const std::vector<Matrix4d> rest = forward_kinematics(old.parents, old.rest);
  Skeleton skeleton;
  for (std::size_t n = 0; n < plan.kept.size(); ++n) {
    const std::size_t j = at(plan.kept[n]);
    skeleton.names.push_back(old.names[j]);
    skeleton.parents.push_back(plan.parents[n]);
    skeleton.bind.push_back(old.bind[j]);
    const Matrix4d* parent = plan.parents[n] < 0 ? nullptr : &rest[at(plan.kept[at(plan.parents[n])])];
    skeleton.rest.push_back(plan.moved[n] == 0 ? old.rest[j] : local_of(parent, rest[j], old.rest[j]));
  }
  asset.skeleton = std::move(skeleton);
}

}  // namespace anigen::prepare
