#include "anigen/eval/transport/metric_tree.h"

#include <limits>

#include "anigen/core/numeric.h"

namespace anigen::eval {

std::optional<MetricTree> metric_tree(const Eigen::MatrixXd& distances) {
  const int n = static_cast<int>(distances.rows());
  MetricTree tree{std::vector<int>(at(n), -1), std::vector<double>(at(n), 0.0), {0}};
  // Prim's algorithm: `nearest` is the tree node closest to a node still outside.
  std::vector<double> gap(at(n), std::numeric_limits<double>::infinity());
  std::vector<int> nearest(at(n), 0);
  std::vector<char> inside(at(n), 0);
  inside[0] = 1;
  // Among joints at one place the first to come in stands for all, so that the tree does not depend on their labels.
  const double largest = distances.maxCoeff(), coincident = 1e-12 * largest;
  for (int last = 0; static_cast<int>(tree.order.size()) < n;) {
    int next = -1;
    for (int j = 0; j < n; ++j) {
      if (inside[at(j)]) continue;
      if (distances(j, last) < gap[at(j)] - coincident) gap[at(j)] = distances(j, last), nearest[at(j)] = last;
      if (next < 0 || gap[at(j)] < gap[at(next)]) next = j;
    }
    inside[at(next)] = 1;
    tree.parents[at(next)] = nearest[at(next)];
    tree.lengths[at(next)] = gap[at(next)];
    tree.order.push_back(next);
    last = next;
  }
  if ((path_lengths(tree) - distances).cwiseAbs().maxCoeff() > 1e-10 * largest) return std::nullopt;
  return tree;
}

Eigen::MatrixXd path_lengths(const MetricTree& tree) {
  const Eigen::Index n = static_cast<Eigen::Index>(tree.parents.size());
  Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t k = 1; k < tree.order.size(); ++k) {
    const int node = tree.order[k], parent = tree.parents[at(node)];
    const double length = tree.lengths[at(node)];
    for (std::size_t l = 0; l < k; ++l) {
      const int other = tree.order[l];
      distances(other, node) = distances(node, other) = distances(other, parent) + length;
    }
  }
  return distances;
}

RowMatrix multiply(const MetricTree& tree, const RowMatrix& values) {
  // Sums over subtrees, then from the root downwards: crossing an edge brings the subtree nearer and all else farther.
  RowMatrix below = values;
  const std::size_t n = tree.order.size();
  for (std::size_t k = n; k-- > 1;) below.row(tree.parents[at(tree.order[k])]) += below.row(tree.order[k]);
  const int root = tree.order[0];
  RowMatrix result(values.rows(), values.cols());
  result.row(root).setZero();
  for (std::size_t k = 1; k < n; ++k) result.row(root) += tree.lengths[at(tree.order[k])] * below.row(tree.order[k]);
  for (std::size_t k = 1; k < n; ++k) {
    const int node = tree.order[k];
    result.row(node) =
        result.row(tree.parents[at(node)]) + tree.lengths[at(node)] * (below.row(root) - 2.0 * below.row(node));
  }
  return result;
}

MetricTree renumbered(const MetricTree& tree, const std::vector<int>& order) {
  const std::size_t n = order.size();
  std::vector<int> position(n);
  for (std::size_t k = 0; k < n; ++k) position[at(order[k])] = static_cast<int>(k);
  MetricTree result{std::vector<int>(n), std::vector<double>(n), {}};
  for (std::size_t k = 0; k < n; ++k) {
    const int parent = tree.parents[at(order[k])];
    result.parents[k] = parent < 0 ? -1 : position[at(parent)];
    result.lengths[k] = tree.lengths[at(order[k])];
  }
  for (const int node : tree.order) result.order.push_back(position[at(node)]);
  return result;
}

}  // namespace anigen::eval
