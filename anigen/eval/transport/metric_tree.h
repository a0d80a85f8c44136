#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

/// A tree whose path lengths are a given distance matrix. Node 0 is the root.
struct MetricTree {
  std::vector<int> parents;     ///< [n], -1 for the root
  std::vector<double> lengths;  ///< [n], of the edge to the parent; 0 for the root
  std::vector<int> order;       ///< [n], every parent before its children
};

/// The tree behind a matrix of tree geodesics, found as its minimum spanning tree; nothing when its path lengths differ
/// from the matrix by more than 1e-10 of the largest distance. O(n^2).
/// @param distances [n,n] symmetric, zero diagonal, nonnegative
std::optional<MetricTree> metric_tree(const Eigen::MatrixXd& distances);

/// Path lengths between all nodes. [n,n]
Eigen::MatrixXd path_lengths(const MetricTree& tree);

/// path_lengths(tree) * values in O(n m), where a plain product takes O(n^2 m). @param values [n,m]
RowMatrix multiply(const MetricTree& tree, const RowMatrix& values);

/// The tree with its nodes renumbered: node order[k] becomes k. Stays rooted where it was.
MetricTree renumbered(const MetricTree& tree, const std::vector<int>& order);

}  // namespace anigen::eval
