#include "anigen/eval/transport/tree_geodesics.h"

#include <vector>

namespace anigen::eval {
namespace {

// Joints with every parent before its children; the single root comes first.
std::vector<int> parents_first(const io::JointTree& tree) {
  std::vector<std::vector<int>> children(tree.size());
  std::vector<int> order;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0) {
      order.push_back(static_cast<int>(j));
    } else {
      children[static_cast<std::size_t>(tree.parents[j])].push_back(static_cast<int>(j));
    }
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int below : children[static_cast<std::size_t>(order[k])]) order.push_back(below);
  }
  return order;
}

}  // namespace

Eigen::MatrixXd tree_geodesics(const io::JointTree& forest) {
  check(forest, "");
  const io::JointTree tree = connected(forest);
  const std::vector<int> order = parents_first(tree);
  const Eigen::Index n = static_cast<Eigen::Index>(tree.size());
  Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t k = 1; k < order.size(); ++k) {
    const int joint = order[k], parent = tree.parents[static_cast<std::size_t>(joint)];
    const double bone =
        (tree.positions[static_cast<std::size_t>(joint)] - tree.positions[static_cast<std::size_t>(parent)]).norm();
    for (std::size_t l = 0; l < k; ++l) {
      const int other = order[l];
      distances(joint, other) = distances(other, joint) = distances(parent, other) + bone;
    }
  }
  return distances;
}

}  // namespace anigen::eval
