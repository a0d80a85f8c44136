#include "anigen/rig/embedding/reduced_skeleton.h"

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::rig {

ReducedSkeleton reduced_skeleton(const TemplateSkeleton& skeleton, double scale) {
  check(skeleton);
  const auto& joints = skeleton.joints;
  std::vector<int> kept_children(joints.size(), 0);
  int root = -1;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j].carried) continue;
    const int parent = joints[j].parent;
    if (parent >= 0 && !joints[at(parent)].carried) {
      ++kept_children[at(parent)];
    } else if (root >= 0) {
      throw InputError("", "template " + skeleton.name, "the joints that are not carried are several trees");
    } else {
      root = static_cast<int>(j);
    }
  }
  ReducedSkeleton reduced;
  std::vector<int> number(joints.size(), -1);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const bool is_root = static_cast<int>(j) == root;
    if (joints[j].carried || (!is_root && kept_children[j] == 1)) continue;
    ReducedJoint joint;
    joint.joint = static_cast<int>(j);
    joint.foot = joints[j].foot;
    joint.fat = joints[j].fat;
    joint.leaf = kept_children[j] == 0;
    joint.position = scale * joints[j].position;
    for (int c = static_cast<int>(j); c != root; c = joints[at(c)].parent) {
      if (c != static_cast<int>(j) && number[at(c)] >= 0) break;
      joint.chain.insert(joint.chain.begin(), c);
    }
    if (!is_root) {
      joint.parent = number[at(joints[at(joint.chain.front())].parent)];
      for (const int c : joint.chain) {
        joint.directions.push_back(scale * (joints[at(c)].position - joints[at(joints[at(c)].parent)].position));
        joint.length += joint.directions.back().norm();
        joint.fractions.push_back(joint.length);
      }
      for (std::size_t c = 0; c < joint.chain.size(); ++c) {
        const double even = static_cast<double>(c + 1) / static_cast<double>(joint.chain.size());
        joint.fractions[c] = joint.length > 0.0 ? joint.fractions[c] / joint.length : even;
      }
    }
    number[j] = static_cast<int>(reduced.joints.size());
    reduced.joints.push_back(joint);
  }
  reduced.children.resize(reduced.joints.size());
  for (std::size_t k = 0; k < reduced.joints.size(); ++k) {
    ReducedJoint& joint = reduced.joints[k];
    if (joints[at(joint.joint)].mirror >= 0) joint.mirror = number[at(joints[at(joint.joint)].mirror)];
    if (joint.parent >= 0) reduced.children[at(joint.parent)].push_back(static_cast<int>(k));
  }
  return reduced;
}

}  // namespace anigen::rig
