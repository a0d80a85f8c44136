#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// A body of boxes along its bones, each moved by the joint at which the bone begins. Faces -Y, Z up.
class MadeBody {
 public:
  /// @param parent -1 for the root @return the joint
  int joint(const std::string& name, int parent, const Eigen::Vector3d& place);
  /// A joint on both sides, called .L and .R. @param parents of left and right
  std::pair<int, int> pair(const std::string& name, std::pair<int, int> parents, const Eigen::Vector3d& left);
  /// A box moved by a joint.
  void box(int joint, const Eigen::Vector3d& low, const Eigen::Vector3d& high);
  /// Boxes along all bones, and around joints without children. @param names false: joints get numbers for names
  Asset asset(double thickness, bool names = true) const;

 private:
  struct Block {
    int joint;
    Eigen::Vector3d low, high;
  };
  std::vector<std::string> names_;
  std::vector<int> parents_;
  std::vector<Eigen::Vector3d> places_;
  std::vector<Block> blocks_;
};

/// Two legs, arms straight aside, head.
Asset made_biped(bool names = true);
/// Four legs, neck and head, a tail of three joints.
Asset made_quadruped(bool names = true);
/// A body that stands on pairs of splayed legs, without names.
Asset made_insect(int pairs);
/// Twelve joints in a line on the ground.
Asset made_snake();
/// Six joints in a line, two fins; nothing reaches the ground but the belly.
Asset made_fish();
/// A foot on the ground, a pole, an arm and a shade.
Asset made_lamp();

}  // namespace anigen::test
