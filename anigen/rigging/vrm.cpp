#include "anigen/rigging/vrm.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>

#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/rigging/humanoid_names.h"

namespace anigen::rigging {

namespace {

constexpr const char* kLicense = "https://vrm.dev/licenses/1.0/";

/// Weight from which a vertex belongs to a joint.
constexpr float kMainWeight = 0.5F;
/// Part of a spring's bone that its radius is at most.
constexpr double kWidest = 0.5;
// VRM's own defaults are 1 and 0.5. Short chains on a head that point up are ears, which stand.
constexpr double kStiffness = 1.0, kEarStiffness = 3.0, kDrag = 0.4;

bool may_carry_springs(std::size_t bone) {
  if (bone >= index_of(HumanBone::kLeftFirstFinger)) return false;
  for (const HumanBone other : {HumanBone::kLeftHand, HumanBone::kLeftFoot, HumanBone::kLeftToes}) {
    if (bone == on_side(other, 0) || bone == on_side(other, 1)) return false;
  }
  return true;
}

/// Words of joints that something else moves than the wind: faces and what is held.
bool says_no_spring(const std::string& name) {
  if (names_helper(name)) return true;
  const std::string low = lower_case(name);
  const auto has = [&low](const char* word) { return low.find(word) != std::string::npos; };
  for (const char* word : {"jaw", "eye", "brow", "lid", "lip", "tongue", "teeth", "tooth", "cheek", "nose", "mouth",
                           "chin", "weapon", "gun", "sword", "shield", "prop", "socket", "finger"}) {
    if (has(word)) return true;
  }
  return false;
}

class SpringSearch {
 public:
  SpringSearch(const Skeleton& skeleton, const Humanoid& humanoid, const Mesh& mesh, const SkinWeights& skin)
      : skeleton_(skeleton),
        positions_(skeleton.positions()),
        mesh_(mesh),
        skin_(skin),
        bones_(humanoid.bones(skeleton.size())),
        weight_(weight_of_joints(skin, skeleton.size())),
        children_(skeleton.size()),
        leads_to_bone_(skeleton.size(), false) {
    for (std::size_t j = skeleton.size(); j-- > 1;) {
      const std::size_t parent = at(skeleton.parents[j]);
      children_[parent].push_back(j);
      leads_to_bone_[parent] = leads_to_bone_[parent] || leads_to_bone_[j] || bones_[j] >= 0;
    }
  }

  std::vector<Spring> find() const {
    std::vector<Spring> springs;
    for (std::size_t j = 1; j < skeleton_.size(); ++j) {
      const int bone = bones_[at(skeleton_.parents[j])];
      if (bone >= 0 && may_carry_springs(at(bone)) && swings(j)) follow(j, at(bone), springs);
    }
    return springs;
  }

 private:
  bool swings(std::size_t joint) const {
    return bones_[joint] < 0 && !leads_to_bone_[joint] && weight_[joint] > 0.0 &&
           !says_no_spring(skeleton_.names[joint]);
  }

  double reach(std::size_t joint) const {
    double most = 0.0;
    for (const std::size_t child : children_[joint])
      most = std::max(most, reach(child) + (positions_[child] - positions_[joint]).norm());
    return most;
  }

  /// The chain along the child that leads farthest; other children begin chains of their own.
  void follow(std::size_t first, std::size_t bone, std::vector<Spring>& springs) const {
    Spring spring;
    spring.name = skeleton_.names[first];
    std::vector<std::size_t> others;
    for (std::size_t joint = first;;) {
      spring.joints.push_back(static_cast<int>(joint));
      std::size_t next = skeleton_.size();
      for (const std::size_t child : children_[joint]) {
        if (next == skeleton_.size() || reach(child) + (positions_[child] - positions_[joint]).norm() >
                                            reach(next) + (positions_[next] - positions_[joint]).norm())
          next = child;
      }
      for (const std::size_t child : children_[joint]) {
        if (child != next && swings(child)) others.push_back(child);
      }
      // An end without weights is where the last bone ends.
      if (next == skeleton_.size()) break;
      joint = next;
    }
    if (spring.joints.size() >= 2) {
      const Eigen::Vector3d way = positions_[at(spring.joints.back())] - positions_[first];
      const bool is_ear = bone == index_of(HumanBone::kHead) && way.z() > 0.5 * way.norm();
      spring.stiffness = is_ear ? kEarStiffness : kStiffness;
      spring.radius = radius(spring.joints);
      springs.push_back(std::move(spring));
    }
    for (const std::size_t other : others) follow(other, bone, springs);
  }

  /// Mean distance of the vertices of a chain from its bones.
  double radius(const std::vector<int>& joints) const {
    std::vector<int> place(skeleton_.size(), -1);
    double longest = 0.0, sum = 0.0;
    for (std::size_t i = 0; i + 1 < joints.size(); ++i) {
      place[at(joints[i])] = static_cast<int>(i);
      longest = std::max(longest, (positions_[at(joints[i + 1])] - positions_[at(joints[i])]).norm());
    }
    std::size_t count = 0;
    for (std::size_t v = 0; v < skin_.rows() && v < mesh_.vertices.size(); ++v) {
      for (std::size_t k = 0; k < skin_.row_size(v); ++k) {
        const Influence& influence = skin_.row(v)[k];
        if (influence.weight < kMainWeight || place[at(influence.joint)] < 0) continue;
        const Eigen::Vector3d from = positions_[at(influence.joint)];
        const Eigen::Vector3d bone = positions_[at(joints[at(place[at(influence.joint)]) + 1])] - from;
        const Eigen::Vector3d point = mesh_.vertices[v].cast<double>() - from;
        const double along =
            bone.squaredNorm() > 0.0 ? std::clamp(point.dot(bone) / bone.squaredNorm(), 0.0, 1.0) : 0.0;
        sum += (point - along * bone).norm();
        ++count;
      }
    }
    return count == 0 ? 0.0 : std::min(sum / static_cast<double>(count), kWidest * longest);
  }

  const Skeleton& skeleton_;
  const std::vector<Eigen::Vector3d> positions_;
  const Mesh& mesh_;
  const SkinWeights& skin_;
  const std::vector<int> bones_;
  const std::vector<double> weight_;
  std::vector<std::vector<std::size_t>> children_;
  std::vector<bool> leads_to_bone_;
};

Json spring_json(const Spring& spring, const std::vector<int>& node_of_joint) {
  Json joints = Json::array();
  for (const int joint : spring.joints) {
    joints.push_back({{"node", node_of_joint[at(joint)]},
                      {"hitRadius", spring.radius},
                      {"stiffness", spring.stiffness},
                      {"gravityPower", 0.0},
                      {"dragForce", kDrag}});
  }
  return {{"name", spring.name}, {"joints", std::move(joints)}};
}

Json meta_json(const VrmMeta& meta) {
  Json json = {{"name", meta.name.empty() ? "model" : meta.name},
               {"authors", meta.authors.empty() ? std::vector<std::string>{"unknown"} : meta.authors},
               {"licenseUrl", kLicense},
               {"avatarPermission", "onlyAuthor"},
               {"allowExcessivelyViolentUsage", false},
               {"allowExcessivelySexualUsage", false},
               {"commercialUsage", "personalNonProfit"},
               {"allowPoliticalOrReligiousUsage", false},
               {"allowAntisocialOrHateUsage", false},
               {"creditNotation", "required"},
               {"allowRedistribution", false},
               {"modification", "prohibited"}};
  if (!meta.copyright.empty()) json["copyrightInformation"] = meta.copyright;
  return json;
}

}  // namespace

std::vector<Spring> find_springs(const Skeleton& skeleton, const Humanoid& humanoid, const Mesh& mesh,
                                 const SkinWeights& skin) {
  return SpringSearch(skeleton, humanoid, mesh, skin).find();
}

Json vrm_extensions(const Skeleton& skeleton, const Humanoid& humanoid, const std::vector<Spring>& springs,
                    const VrmMeta& meta, const std::vector<int>& node_of_joint) {
  Json bones = Json::object();
  for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
    const int joint = humanoid[bone];
    if (joint < 0 || at(joint) >= skeleton.size() || node_of_joint[at(joint)] < 0) continue;
    bones[bone_name(bone, NameStyle::kVrm)] = {{"node", node_of_joint[at(joint)]}};
  }
  Json extensions = {
      {"VRMC_vrm",
       {{"specVersion", "1.0"}, {"meta", meta_json(meta)}, {"humanoid", {{"humanBones", std::move(bones)}}}}}};
  if (springs.empty()) return extensions;
  Json list = Json::array();
  for (const Spring& spring : springs) list.push_back(spring_json(spring, node_of_joint));
  extensions["VRMC_springBone"] = {{"specVersion", "1.0"}, {"springs", std::move(list)}};
  return extensions;
}

double degrees_from_t_pose(const Skeleton& skeleton, const Humanoid& humanoid) {
  double largest = 0.0;
  for (const int side : {0, 1}) {
    const int upper = humanoid[on_side(HumanBone::kLeftUpperArm, side)];
    const int lower = humanoid[on_side(HumanBone::kLeftLowerArm, side)];
    if (upper < 0 || lower < 0) continue;
    const Eigen::Vector3d arm = (skeleton.bind[at(lower)] - skeleton.bind[at(upper)]).topRightCorner<3, 1>();
    if (!(arm.norm() > 0.0)) continue;
    largest = std::max(largest, std::asin(std::min(1.0, std::abs(arm.z()) / arm.norm())) * 57.29577951308232);
  }
  return largest;
}

}  // namespace anigen::rigging
