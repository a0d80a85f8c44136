#include "anigen/io/gltf/import_rig.h"

#include <algorithm>
#include <functional>
#include <queue>
#include <unordered_set>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/import_joints.h"

namespace anigen::io::gltf_import {
namespace {

using Eigen::Matrix4d;

// What lies between the nodes and the joints above them.
struct Hierarchy {
  std::vector<int> tops;                // joints without a joint above
  std::vector<int> joint_above;         // [N] node of the nearest joint strictly above, or -1
  std::vector<FoldedTransform> folded;  // [N] joints: the static nodes between the joint above and this one
  std::vector<Matrix4d> below_joint;    // [N] as in Rig
  std::vector<Matrix4d> world;          // [N]
  std::size_t folded_nodes = 0;
};

Hierarchy walk_down(const Document& document, const std::vector<char>& is_joint) {
  const std::size_t nodes = document.nodes.size();
  const std::vector<int> joints_below = count_below(document, is_joint);
  Hierarchy result;
  result.joint_above.assign(nodes, -1);
  result.folded.resize(nodes);
  result.below_joint.assign(nodes, Matrix4d::Identity());
  result.world.resize(nodes);
  for (const int n : document.top_down) {
    const Node& node = document.nodes[at(n)];
    const int parent = node.parent;
    const bool is_root = parent < 0, under_joint = !is_root && is_joint[at(parent)] != 0;
    result.world[at(n)] = is_root ? node.matrix : Matrix4d(result.world[at(parent)] * node.matrix);
    if (!is_root) result.joint_above[at(n)] = under_joint ? parent : result.joint_above[at(parent)];
    // Of a joint: what comes before it. Of another node: including the node.
    FoldedTransform& folded = result.folded[at(n)];
    if (!is_root && !under_joint) folded = result.folded[at(parent)];
    if (is_joint[at(n)] != 0) {
      if (result.joint_above[at(n)] < 0) result.tops.push_back(n);
      continue;
    }
    result.below_joint[at(n)] =
        is_root || under_joint ? node.matrix : Matrix4d(result.below_joint[at(parent)] * node.matrix);
    if (joints_below[at(n)] == 0) continue;
    if (result.joint_above[at(n)] >= 0) ++result.folded_nodes;
    folded = folded * as_similarity(node.matrix).value();  // choose_joints() made joints of all others
  }
  return result;
}

std::string unique_name(const std::string& wanted, std::size_t joint, std::unordered_set<std::string>& taken) {
  const std::string base = wanted.empty() ? "joint_" + std::to_string(joint) : wanted;
  std::string name = base;
  // Larger steps once the small numbers are used up, so that a file of equal names does not take quadratic time.
  for (std::size_t k = 2; !taken.insert(name).second; k += k < 100 ? 1 : joint) name = base + "_" + std::to_string(k);
  return name;
}

class RigBuilder {
 public:
  RigBuilder(const Document& document, const JointChoice& choice)
      : document_(document), is_joint_(choice.is_joint), hierarchy_(walk_down(document, choice.is_joint)) {
    rig_.skin_used = choice.skin_used;
    rig_.joint_of_node.assign(document.nodes.size(), -1);
  }

  Rig build(Notes& notes) {
    above_tops_ = y_up_to_z_up();
    if (hierarchy_.tops.size() > 1) make_root(notes);
    append_joints();
    rig_.nearest_joint.assign(document_.nodes.size(), -1);
    std::size_t sheared = 0;
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      const int above = hierarchy_.joint_above[n];
      if (is_joint_[n] != 0)
        rig_.nearest_joint[n] = rig_.joint_of_node[n];
      else if (above >= 0)
        rig_.nearest_joint[n] = rig_.joint_of_node[at(above)];
      sheared += is_joint_[n] != 0 && document_.nodes[n].shear > 1e-6 ? 1 : 0;
    }
    rig_.below_joint = std::move(hierarchy_.below_joint);
    notes.tally("duplicate_joint_names", "joints had the name of an earlier one and were given another",
                repeated_names_);
    notes.tally("folded_node", "static nodes between joints were folded into them", hierarchy_.folded_nodes);
    notes.tally("sheared_joint", "joints have a sheared matrix; they rest in the nearest pose without shear", sheared);
    return std::move(rig_);
  }

 private:
  int append(const std::string& name, int parent, int node, const FoldedTransform& prefix, const Transform& local) {
    const std::size_t joint = rig_.skeleton.size();
    repeated_names_ += !name.empty() && taken_.count(name) > 0 ? 1 : 0;
    rig_.skeleton.names.push_back(unique_name(name, joint, taken_));
    rig_.skeleton.parents.push_back(parent);
    rig_.skeleton.rest.push_back(prefix * local);
    rig_.prefix.push_back(prefix);
    rig_.node_of_joint.push_back(node);
    return static_cast<int>(joint);
  }

  // One root where the nodes of all roots branch, so that the tree stays compact around the character.
  void make_root(Notes& notes) {
    const int ancestor = common_ancestor(document_, hierarchy_.tops);
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    if (ancestor >= 0) position = hierarchy_.world[at(ancestor)].topRightCorner<3, 1>();
    FoldedTransform root = above_tops_;
    root.translation = root * position;
    // A joint of the file keeps its own name.
    const bool is_taken = std::any_of(document_.nodes.begin(), document_.nodes.end(),
                                      [](const Node& node) { return node.name == "root"; });
    append(is_taken ? "common_root" : "root", -1, -1, root, Transform());
    above_tops_ = {};
    above_tops_.translation = -position;
    notes.tally("several_roots", "joint roots were put under one made root joint", hierarchy_.tops.size());
  }

  // Parents before children, otherwise in the order of the file.
  void append_joints() {
    std::vector<std::vector<int>> children(document_.nodes.size());
    for (std::size_t n = 0; n < children.size(); ++n) {
      if (is_joint_[n] != 0 && hierarchy_.joint_above[n] >= 0)
        children[at(hierarchy_.joint_above[n])].push_back(static_cast<int>(n));
    }
    const std::vector<int>& tops = hierarchy_.tops;
    std::priority_queue<int, std::vector<int>, std::greater<int>> ready(tops.begin(), tops.end());
    while (!ready.empty()) {
      const int n = ready.top();
      ready.pop();
      const int above = hierarchy_.joint_above[at(n)];
      const int parent = above >= 0 ? rig_.joint_of_node[at(above)] : (tops.size() > 1 ? 0 : -1);
      const FoldedTransform& folded = hierarchy_.folded[at(n)];
      const Node& node = document_.nodes[at(n)];
      rig_.joint_of_node[at(n)] = append(node.name, parent, n, above >= 0 ? folded : above_tops_ * folded, node.local);
      for (const int child : children[at(n)]) ready.push(child);
    }
  }

  const Document& document_;
  const std::vector<char>& is_joint_;
  Hierarchy hierarchy_;
  FoldedTransform above_tops_;
  std::unordered_set<std::string> taken_;
  std::size_t repeated_names_ = 0;
  Rig rig_;
};

}  // namespace

Rig build_rig(const Document& document, const std::vector<char>& moving, const ImportOptions& options, Notes& notes) {
  const JointChoice choice = choose_joints(document, moving, options.require_rig, notes);
  const auto joints = static_cast<std::size_t>(std::count(choice.is_joint.begin(), choice.is_joint.end(), 1));
  if (joints > options.max_joints) {
    throw InputError(document.file, "/skins",
                     std::to_string(joints) + " joints exceed the limit of " + std::to_string(options.max_joints));
  }
  return RigBuilder(document, choice).build(notes);
}

}  // namespace anigen::io::gltf_import
