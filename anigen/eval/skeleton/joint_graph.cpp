#include "anigen/eval/skeleton/joint_graph.h"

namespace anigen::eval {

JointGraph joint_graph(const io::JointTree& tree) {
  check(tree, "");
  JointGraph graph;
  graph.joints = tree.positions;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] >= 0) graph.bones.push_back({tree.parents[j], static_cast<int>(j)});
  }
  return graph;
}

std::vector<BoneLine> bone_lines(const JointGraph& graph) {
  std::vector<BoneLine> lines;
  for (const auto& [parent, child] : graph.bones) {
    lines.push_back({graph.joints[static_cast<std::size_t>(parent)], graph.joints[static_cast<std::size_t>(child)]});
  }
  if (lines.empty()) {
    for (const Eigen::Vector3d& joint : graph.joints) lines.push_back({joint, joint});
  }
  return lines;
}

}  // namespace anigen::eval
