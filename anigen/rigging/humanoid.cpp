#include "anigen/rigging/humanoid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/rigging/humanoid_limbs.h"
#include "anigen/rigging/humanoid_names.h"

namespace anigen::rigging {

namespace {

using Joints = std::array<int, kHumanBones>;
using Points = std::vector<Eigen::Vector3d>;

/// Part of the height by which a detached foot may stand beside the lower end of its leg.
constexpr double kFootReach = 0.15;
/// Part of a leg's length by which knees stand out before they tell the direction of a body.
constexpr double kBentKnee = 0.01;
/// Rise from hips to head over their distance, below which a body goes on four legs, or lies.
constexpr double kLeastUpright = 0.5;

std::size_t count_required(const Joints& joints) {
  std::size_t count = 0;
  for (std::size_t bone = 0; bone < kHumanBones; ++bone) count += is_required(bone) && joints[bone] >= 0;
  return count;
}

bool stands_above(const std::vector<int>& parents, int above, int joint) {
  for (int j = joint; j >= 0; j = parents[at(j)]) {
    if (j == above) return true;
  }
  return false;
}

/// Joints from one to another along the tree, both included.
std::vector<int> way_between(const std::vector<int>& parents, int from, int to) {
  std::vector<int> up, down;
  int meeting = to;
  while (meeting >= 0 && !stands_above(parents, meeting, from)) {
    down.push_back(meeting);
    meeting = parents[at(meeting)];
  }
  for (int j = from; j >= 0; j = parents[at(j)]) {
    up.push_back(j);
    if (j == meeting) break;
  }
  up.insert(up.end(), down.rbegin(), down.rend());
  return up;
}

class HumanoidSearch {
 public:
  HumanoidSearch(const Skeleton& skeleton, const std::vector<double>& weight)
      : skeleton_(skeleton), positions_(skeleton.positions()), parents_(skeleton.parents) {
    for (const double w : weight) carries_.push_back(w > 0.0 ? 1 : 0);
    if (std::find(carries_.begin(), carries_.end(), 1) == carries_.end()) carries_.clear();
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const Eigen::Vector3d& p : positions_) {
      low = std::min(low, p.z());
      high = std::max(high, p.z());
    }
    low_ = low;
    height_ = high - low;
  }

  Humanoid find(NameHints hints) const {
    Humanoid best;
    if (!(height_ > 0.0) || !std::isfinite(height_)) return best;
    std::size_t found = 0;
    const auto take = [&](const Joints& joints, bool by_names) {
      Humanoid candidate = finished(joints, by_names);
      const std::size_t count = count_required(candidate.joints);
      if (count <= found) return;
      found = count;
      best = candidate;
    };
    std::vector<Joints> by_place;
    for (const Eigen::Vector3d& across : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0)}) {
      if (!carries_.empty()) by_place.push_back(joints_by_place(positions_, parents_, carries_, across));
      by_place.push_back(joints_by_place(positions_, parents_, {}, across));
    }
    if (hints == NameHints::kUsed) {
      const Joints named = joints_by_name(skeleton_.names, parents_, carries_);
      take(named, true);
      // Places fill in for names with joints that no name has taken.
      for (const Joints& placed : by_place) {
        Joints both = named;
        for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
          const bool taken = std::find(both.begin(), both.end(), placed[bone]) != both.end();
          if (both[bone] < 0 && !taken) both[bone] = placed[bone];
        }
        if (count_required(named) * 2 > 15) take(both, true);
      }
    }
    for (const Joints& placed : by_place) take(placed, false);
    return best;
  }

 private:
  const Eigen::Vector3d& place(int joint) const { return positions_[at(joint)]; }

  /// Anchors → bones: feet, trunk, then sides.
  Humanoid finished(Joints joints, bool by_names) const {
    Humanoid humanoid;
    humanoid.by_names = by_names;
    const int hips = joints[index_of(HumanBone::kHips)], head = joints[index_of(HumanBone::kHead)];
    if (hips >= 0 && head >= 0) {
      const Eigen::Vector3d rise = place(head) - place(hips);
      if (rise.z() < kLeastUpright * rise.norm()) return humanoid;
    }
    for (const int side : {0, 1}) find_foot(joints, side);
    find_trunk(joints);
    humanoid.joints = joints;
    face(humanoid);
    return humanoid;
  }

  /// The foot of a leg that ends above the ground: of rigs for IK it hangs elsewhere.
  void find_foot(Joints& joints, int side) const {
    int& foot = joints[on_side(HumanBone::kLeftFoot, side)];
    const int knee = joints[on_side(HumanBone::kLeftLowerLeg, side)];
    if (foot >= 0 || knee < 0) return;
    double nearest = kFootReach * height_;
    for (std::size_t j = 0; j < positions_.size(); ++j) {
      const int joint = static_cast<int>(j);
      if (std::find(joints.begin(), joints.end(), joint) != joints.end()) continue;
      const Eigen::Vector3d apart = positions_[j] - place(knee);
      if (apart.z() > -0.02 * height_ || names_target(joint)) continue;
      const double beside = std::hypot(apart.x(), apart.y()) + std::abs(positions_[j].z() - low_);
      if (beside >= nearest || stands_above(parents_, joint, knee)) continue;
      nearest = beside;
      foot = joint;
    }
  }

  bool names_target(int joint) const { return names_helper(skeleton_.names[at(joint)]); }

  /// Spine to upper chest: the way from the hips to where the arms begin.
  void find_trunk(Joints& joints) const {
    for (const HumanBone bone : {HumanBone::kSpine, HumanBone::kChest, HumanBone::kUpperChest})
      joints[index_of(bone)] = -1;
    const int hips = joints[index_of(HumanBone::kHips)];
    if (hips < 0) return;
    std::array<int, 2> arms;
    for (const int side : {0, 1}) {
      const int shoulder = joints[on_side(HumanBone::kLeftShoulder, side)];
      arms[at(side)] = shoulder >= 0 ? shoulder : joints[on_side(HumanBone::kLeftUpperArm, side)];
      if (arms[at(side)] < 0) return;
    }
    int meeting = arms[0];
    while (meeting >= 0 && (meeting == arms[0] || !stands_above(parents_, meeting, arms[1])))
      meeting = parents_[at(meeting)];
    if (meeting < 0) return;
    const std::vector<int> way = way_between(parents_, hips, meeting);
    std::vector<int> spine, light;
    for (std::size_t i = 1; i < way.size(); ++i) {
      const bool taken = std::find(joints.begin(), joints.end(), way[i]) != joints.end();
      if (taken || names_target(way[i])) continue;
      const bool heavy = carries_.empty() || carries_[at(way[i])] != 0;
      (heavy ? spine : light).push_back(way[i]);
    }
    if (spine.empty()) spine = light;
    if (spine.empty()) return;
    joints[index_of(HumanBone::kSpine)] = spine.front();
    if (spine.size() >= 2) joints[index_of(HumanBone::kChest)] = spine.size() == 2 ? spine[1] : spine[spine.size() - 2];
    if (spine.size() >= 3) joints[index_of(HumanBone::kUpperChest)] = spine.back();
  }

  /// Sides by places. Toes point forward, and so does a foot beyond its ankle; knees bend forward.
  void face(Humanoid& humanoid) const {
    const Joints& joints = humanoid.joints;
    const auto both = [&](HumanBone bone) { return std::pair{joints[on_side(bone, 0)], joints[on_side(bone, 1)]}; };
    Eigen::Vector3d across = Eigen::Vector3d::Zero();  // from right to left, as they are now
    for (const HumanBone bone :
         {HumanBone::kLeftUpperLeg, HumanBone::kLeftLowerLeg, HumanBone::kLeftUpperArm, HumanBone::kLeftLowerArm}) {
      const auto [left, right] = both(bone);
      if (left >= 0 && right >= 0) across += place(left) - place(right);
    }
    across.z() = 0.0;
    if (!(across.norm() > 1e-6 * height_)) return;
    across.normalize();
    Eigen::Vector3d ahead = Eigen::Vector3d::Zero();
    for (const int side : {0, 1}) {
      const int hip = joints[on_side(HumanBone::kLeftUpperLeg, side)];
      const int knee = joints[on_side(HumanBone::kLeftLowerLeg, side)];
      const int foot = joints[on_side(HumanBone::kLeftFoot, side)];
      const int toes = joints[on_side(HumanBone::kLeftToes, side)];
      if (foot >= 0 && toes >= 0) ahead += place(toes) - place(foot);
      if (hip < 0 || knee < 0 || foot < 0 || toes >= 0) continue;
      const Eigen::Vector3d leg = place(foot) - place(hip);
      if (!(leg.norm() > 0.0)) continue;
      const Eigen::Vector3d bent =
          place(knee) - place(hip) - leg * (place(knee) - place(hip)).dot(leg) / leg.squaredNorm();
      if (bent.norm() > kBentKnee * leg.norm()) ahead += bent;
    }
    ahead -= across * ahead.dot(across);
    ahead.z() = 0.0;
    // left = up × forward, so forward = left × up.
    const Eigen::Vector3d named_ahead = across.cross(Eigen::Vector3d::UnitZ());
    Eigen::Vector3d forward;
    humanoid.forward_is_known = true;
    if (ahead.norm() > 1e-3 * height_) {
      forward = ahead.dot(named_ahead) > 0.0 ? named_ahead : Eigen::Vector3d(-named_ahead);
    } else if (humanoid.by_names) {
      forward = named_ahead;
    } else {
      humanoid.forward_is_known = false;
      const Eigen::Vector3d usual(1e-3, -1.0, 0.0);  // −y; of a body along y the one who faces +x
      forward = usual.dot(named_ahead) > 0.0 ? named_ahead : Eigen::Vector3d(-named_ahead);
    }
    humanoid.forward = forward;
    if (forward.dot(named_ahead) > 0.0) return;
    Joints swapped = joints;
    for (std::size_t bone = 0; bone < kHumanBones; ++bone) swapped[bone] = joints[mirrored_bone(bone)];
    humanoid.joints = swapped;
  }

  const Skeleton& skeleton_;
  const Points positions_;
  const std::vector<int>& parents_;
  std::vector<char> carries_;
  double low_ = 0.0, height_ = 0.0;
};

}  // namespace

std::vector<int> Humanoid::bones(std::size_t count) const {
  std::vector<int> bones(count, -1);
  for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
    if (joints[bone] >= 0 && at(joints[bone]) < count) bones[at(joints[bone])] = static_cast<int>(bone);
  }
  return bones;
}

std::vector<std::string> Humanoid::missing() const {
  std::vector<std::string> names;
  for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
    if (is_required(bone) && joints[bone] < 0) names.push_back(bone_name(bone, NameStyle::kVrm));
  }
  return names;
}

Humanoid find_humanoid(const Skeleton& skeleton, const std::vector<double>& weight, NameHints hints) {
  if (!weight.empty() && weight.size() != skeleton.size())
    throw InputError("", "weight", "there are as many as joints, or none");
  return HumanoidSearch(skeleton, weight).find(hints);
}

std::vector<double> weight_of_joints(const SkinWeights& skin, std::size_t joints) {
  std::vector<double> weight(joints, 0.0);
  for (const Influence& influence : skin.influences) {
    if (influence.joint >= 0 && at(influence.joint) < joints)
      weight[at(influence.joint)] += static_cast<double>(influence.weight);
  }
  return weight;
}

void require_humanoid(const Humanoid& humanoid, const std::string& file, const std::string& what) {
  const std::vector<std::string> missing = humanoid.missing();
  if (missing.empty()) return;
  throw InputError(file, "", what + " is for humanoids, and no joint was found for: " + joined(missing));
}

std::vector<int> humanoid_parents(const std::vector<int>& parents, const Humanoid& humanoid) {
  std::vector<int> result = parents;
  const int hips = humanoid[HumanBone::kHips];
  if (hips < 0) return result;
  // The hips come above every bone; what is above the topmost of those stays above the hips.
  const std::vector<int> bones = humanoid.bones(parents.size());
  int above = result[at(hips)];
  for (int j = result[at(hips)]; j >= 0; j = result[at(j)]) {
    if (bones[at(j)] >= 0) above = result[at(j)];
  }
  result[at(hips)] = above;
  for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
    const std::size_t needed = required_parent(bone);
    if (humanoid[bone] < 0 || needed == kHumanBones || humanoid[needed] < 0) continue;
    const int joint = humanoid[bone];
    if (stands_above(result, humanoid[needed], joint)) continue;
    // The joint below it that leads to the bone it needs takes its place, so that no ring arises.
    for (int j = humanoid[needed]; j >= 0; j = result[at(j)]) {
      if (result[at(j)] != joint) continue;
      result[at(j)] = result[at(joint)];
      break;
    }
    result[at(joint)] = humanoid[needed];
  }
  return result;
}

}  // namespace anigen::rigging
