#pragma once
#include <Eigen/Core>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"

namespace anigen::test {

/// A person of 1.8 m who stands at (3, 2, 0.5) and faces −y, arms out: joints by the words below, which tests give
/// names of any custom. Twist joints lie in the middle of upper arms, ends beyond head, hands and toes, a tail of three
/// joints hangs on the hips.
class HumanRig {
 public:
  struct Joint {
    std::string word, parent;
    Eigen::Vector3d place;
    bool carries = true;  ///< weights
  };

  HumanRig() {
    add("root", "", {0, 0, 0}, false);
    add("hips", "root", {0, 0, 0.95});
    add("spine", "hips", {0, 0, 1.1});
    add("chest", "spine", {0, 0.02, 1.3});
    add("neck", "chest", {0, 0.02, 1.5});
    add("head", "neck", {0, 0, 1.6});
    add("head_end", "head", {0, 0, 1.8}, false);
    for (const double side : {1.0, -1.0}) {
      const std::string s = side > 0 ? "l_" : "r_";
      const auto limb = [&](const std::string& word, const std::string& parent, double x, double y, double z,
                            bool carries = true) {
        add(s + word, parent, {side * x, y, z}, carries);
      };
      limb("shoulder", "chest", 0.04, 0, 1.45);
      limb("upper_arm", s + "shoulder", 0.18, 0, 1.45);
      limb("arm_twist", s + "upper_arm", 0.32, 0.01, 1.45);
      limb("lower_arm", s + "upper_arm", 0.46, 0.01, 1.45);
      limb("hand", s + "lower_arm", 0.72, 0, 1.45);
      limb("hand_end", s + "hand", 0.9, 0, 1.45, false);
      limb("upper_leg", "hips", 0.1, 0, 0.9);
      limb("lower_leg", s + "upper_leg", 0.1, -0.02, 0.5);
      limb("foot", s + "lower_leg", 0.1, 0.02, 0.08);
      limb("toes", s + "foot", 0.1, -0.12, 0.02);
      limb("toes_end", s + "toes", 0.1, -0.2, 0.02, false);
    }
    add("tail_1", "hips", {0, 0.1, 0.95});
    add("tail_2", "tail_1", {0, 0.3, 0.9});
    add("tail_3", "tail_2", {0, 0.5, 0.85});
  }

  std::vector<Joint> joints;

  Joint& operator[](const std::string& word) { return joints[index_.at(word)]; }
  int index(const std::string& word) const { return static_cast<int>(index_.at(word)); }

  /// Joints called "j0", "j1", …, or by their words. @param turn of the whole body about the vertical
  Skeleton skeleton(bool named = false, const Eigen::Matrix3d& turn = Eigen::Matrix3d::Identity()) const {
    std::vector<Eigen::Vector3d> places;
    std::vector<int> parents;
    std::vector<std::string> names;
    for (std::size_t j = 0; j < joints.size(); ++j) {
      places.push_back(turn * joints[j].place + Eigen::Vector3d(3, 2, 0.5));
      parents.push_back(joints[j].parent.empty() ? -1 : index(joints[j].parent));
      names.push_back(named ? joints[j].word : "j" + std::to_string(j));
    }
    return skeleton_from_joints(places, parents, names);
  }

  std::vector<double> weight() const {
    std::vector<double> weight;
    for (const Joint& joint : joints) weight.push_back(joint.carries ? 1.0 : 0.0);
    return weight;
  }

  /// Spheres at the joints and cones along the bones, bound to the joints that carry weights.
  Asset asset(bool named = false) const {
    Asset asset = geometry::skeleton_asset(skeleton(named));
    asset.name = "person";
    for (Influence& influence : asset.skin.influences) {
      while (!joints[at(influence.joint)].carries) {
        const std::string& parent = joints[at(influence.joint)].parent;
        influence.joint = parent.empty() ? index("hips") : index(parent);
      }
    }
    return asset;
  }

 private:
  void add(const std::string& word, const std::string& parent, const Eigen::Vector3d& place, bool carries = true) {
    index_[word] = joints.size();
    joints.push_back({word, parent, place, carries});
  }

  std::map<std::string, std::size_t> index_;
};

}  // namespace anigen::test
