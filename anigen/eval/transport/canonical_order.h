#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/metric_tree.h"

namespace anigen::eval {

/// What canonical_order needs to know of one tree.
struct LabelledTree {
  MetricTree tree;
  Eigen::VectorXd masses;                  ///< [n]
  std::vector<Eigen::Vector3d> positions;  ///< [n] or empty; only breaks ties between interchangeable branches
};

/// Two trees numbered without regard to the labels they came with, so that what is computed from them cannot depend on
/// these labels.
struct CanonicalOrder {
  std::vector<int> first, second;  ///< first[k]: the node that comes k-th; each tree rooted at its centroid, preorder
  MetricTree first_tree, second_tree;  ///< renumbered and rooted so
  /// Same branching, edge lengths and masses (to 1e-9 of the largest): first[k] -> second[k] is an isomorphism.
  bool isomorphic = false;
};

/// Canonical codes in the manner of Aho, Hopcroft and Ullman: children are sorted by edge length class, mass class and
/// their own children's codes, then by the exact numbers, then by position. The root is the node of least mean
/// distance.
CanonicalOrder canonical_order(const LabelledTree& first, const LabelledTree& second);

}  // namespace anigen::eval
