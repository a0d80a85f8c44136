#include "anigen/loaders/anymate/bone_layout.h"

#include <array>
#include <map>
#include <numeric>
#include <optional>
#include <string>

#include "anigen/core/error.h"

namespace anigen::loaders {
namespace {

constexpr float kReach = 1.25f;            // of a bone without a child to end at, in means of its weights
constexpr float kShortest = 1e-5f;         // such a bone is at least this long
constexpr float kUnweightedReach = 0.01f;  // of a bone that no point hangs on
const Eigen::Vector3f kFallback(0.0f, 0.0f, 0.001f);

struct Bones {
  std::vector<std::size_t> of_joint;  // [K] the rig's joint at the head, ascending
  std::vector<int> parents;           // [K] bone or -1
};

// What each joint holds: Σ w and Σ w · point.
struct Held {
  std::vector<double> weight;
  std::vector<Eigen::Vector3d> moment;
};

Held held_points(std::size_t joints, const std::vector<Eigen::Vector3f>& points, const SkinWeights& skin) {
  Held held{std::vector<double>(joints, 0.0), std::vector<Eigen::Vector3d>(joints, Eigen::Vector3d::Zero())};
  for (std::size_t p = 0; p < points.size(); ++p) {
    const Influence* row = skin.row(p);
    for (std::size_t i = 0; i < skin.row_size(p); ++i) {
      const auto joint = static_cast<std::size_t>(row[i].joint);
      held.weight[joint] += row[i].weight;
      held.moment[joint] += row[i].weight * points[p].cast<double>();
    }
  }
  return held;
}

// The joint itself or its nearest ancestor that is used, -1 for none.
int used_from(const std::vector<int>& parents, const std::vector<bool>& used, int joint) {
  while (joint >= 0 && !used[static_cast<std::size_t>(joint)]) joint = parents[static_cast<std::size_t>(joint)];
  return joint;
}

// Bones that lost their root: the one nearest to the middle of their heads becomes the others' parent.
void join_orphans(const std::vector<Eigen::Vector3f>& joints, const std::vector<std::size_t>& orphans, Bones& bones) {
  const auto head = [&](std::size_t bone) -> const Eigen::Vector3f& { return joints[bones.of_joint[bone]]; };
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  for (const std::size_t bone : orphans) middle += head(bone) / static_cast<float>(orphans.size());
  std::size_t chosen = orphans.front();
  for (const std::size_t bone : orphans) {
    if ((head(bone) - middle).norm() < (head(chosen) - middle).norm()) chosen = bone;
  }
  for (const std::size_t bone : orphans) {
    if (bone != chosen) bones.parents[bone] = static_cast<int>(chosen);
  }
}

int root_of(const std::vector<int>& parents, int joint) {
  while (parents[static_cast<std::size_t>(joint)] >= 0) joint = parents[static_cast<std::size_t>(joint)];
  return joint;
}

Bones used_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                 const std::vector<bool>& used) {
  Bones bones;
  std::vector<int> bone_at(joints.size(), -1);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!used[j]) continue;
    bone_at[j] = static_cast<int>(bones.of_joint.size());
    bones.of_joint.push_back(j);
  }
  if (bones.of_joint.empty()) throw InputError("", "skin", "nothing hangs on any joint");
  std::map<int, std::vector<std::size_t>> orphans;  // by the root that went
  for (std::size_t k = 0; k < bones.of_joint.size(); ++k) {
    const auto joint = static_cast<int>(bones.of_joint[k]);
    const int above = used_from(parents, used, parents[bones.of_joint[k]]);
    bones.parents.push_back(above < 0 ? -1 : bone_at[static_cast<std::size_t>(above)]);
    const int root = root_of(parents, joint);
    if (above < 0 && root != joint) orphans[root].push_back(k);
  }
  for (const auto& [root, children] : orphans) join_orphans(joints, children, bones);
  return bones;
}

Eigen::Vector3f skin_direction(const std::vector<Eigen::Vector3f>& joints, const Bones& bones, const Held& held,
                               std::size_t bone) {
  const std::size_t joint = bones.of_joint[bone];
  const Eigen::Vector3f& head = joints[joint];
  if (held.weight[joint] > 0.0) {
    const Eigen::Vector3f mean = (held.moment[joint] / held.weight[joint]).cast<float>();
    const Eigen::Vector3f way = kReach * (mean - head);
    return way.norm() < kShortest ? kFallback : way;
  }
  if (bones.parents[bone] < 0) return kFallback;
  const Eigen::Vector3f way = head - joints[bones.of_joint[static_cast<std::size_t>(bones.parents[bone])]];
  return way.norm() < 1e-8f ? kFallback : Eigen::Vector3f(way.normalized() * kUnweightedReach);
}

using Key = std::array<float, 3>;
Key key_of(const Eigen::Vector3f& p) { return {p.x(), p.y(), p.z()}; }

struct Tails {
  std::vector<Eigen::Vector3f> at;     // [K]
  std::vector<bool> several_children;  // [K]
};

Tails find_tails(const std::vector<Eigen::Vector3f>& joints, const Bones& bones, const Held& held) {
  const std::size_t count = bones.of_joint.size();
  std::vector<std::optional<Eigen::Vector3f>> tails(count);
  Tails found;
  found.several_children.assign(count, false);
  for (std::size_t k = 0; k < count; ++k) {
    if (bones.parents[k] < 0) continue;
    const auto parent = static_cast<std::size_t>(bones.parents[k]);
    const Eigen::Vector3f& head = joints[bones.of_joint[k]];
    if (joints[bones.of_joint[parent]] == head) continue;
    if (tails[parent])
      found.several_children[parent] = true;
    else
      tails[parent] = head;
  }
  std::map<Key, std::size_t> ends;
  for (std::size_t k = 0; k < count; ++k) {
    if (!tails[k]) tails[k] = joints[bones.of_joint[k]] + skin_direction(joints, bones, held, k);
    if (!ends.emplace(key_of(*tails[k]), k).second) {
      throw InputError("", "bone " + std::to_string(k), "ends where another one ends");
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (found.several_children[k]) tails[k] = joints[bones.of_joint[k]] + skin_direction(joints, bones, held, k);
    found.at.push_back(*tails[k]);
  }
  return found;
}

}  // namespace

BoneLayout lay_out_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                         const std::vector<bool>& used, const std::vector<Eigen::Vector3f>& points,
                         const SkinWeights& skin) {
  const Held held = held_points(joints.size(), points, skin);
  const Bones bones = used_bones(joints, parents, used);
  const Tails tails = find_tails(joints, bones, held);

  BoneLayout layout;
  layout.tails = tails.at;
  layout.bone_of.assign(joints.size(), -1);
  std::map<Key, int> number;
  const auto joint_at = [&](const Eigen::Vector3f& position) {
    const auto [place, is_new] = number.emplace(key_of(position), static_cast<int>(layout.joints.size()));
    if (is_new) layout.joints.push_back(position);
    return place->second;
  };
  const std::size_t count = bones.of_joint.size();
  std::vector<int> head_joint(count), tail_joint(count);
  for (std::size_t k = 0; k < count; ++k) {
    layout.bone_of[bones.of_joint[k]] = static_cast<int>(k);
    layout.heads.push_back(joints[bones.of_joint[k]]);
    head_joint[k] = joint_at(layout.heads.back());
  }
  for (std::size_t k = 0; k < count; ++k) tail_joint[k] = joint_at(tails.at[k]);

  layout.conns.assign(layout.joints.size(), -1);
  for (std::size_t k = 0; k < count; ++k) {
    int& conn = layout.conns[static_cast<std::size_t>(tail_joint[k])];
    if (conn >= 0 && conn != head_joint[k]) {
      throw InputError("", "bone " + std::to_string(k), "ends at a joint that has another parent");
    }
    conn = head_joint[k];
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (bones.parents[k] < 0 || !tails.several_children[static_cast<std::size_t>(bones.parents[k])]) continue;
    int& conn = layout.conns[static_cast<std::size_t>(head_joint[k])];
    if (conn < 0) conn = tail_joint[static_cast<std::size_t>(bones.parents[k])];
  }
  for (std::size_t j = 0; j < layout.conns.size(); ++j) {
    if (layout.conns[j] < 0) layout.conns[j] = static_cast<int>(j);
  }
  return layout;
}

}  // namespace anigen::loaders
