#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics {

/// Distances along the skeleton: sums of bone lengths on the path between two joints. A forest is first joined by
/// connected(), so every distance is finite. Time and memory O(n^2).
/// Source: docs/reference/training.md, 7.3.
/// @param tree n joints, parents in any order  @return [n,n] symmetric, zero diagonal, in the unit of the positions
/// @throws InputError as check()
Eigen::MatrixXd tree_geodesics(const JointTree& tree);

/// A tree whose path lengths are a given distance matrix. Node 0 is the root.
struct MetricTree {
  std::vector<int> parents;     ///< [n], -1 for the root
  std::vector<double> lengths;  ///< [n], of the edge to the parent; 0 for the root
  std::vector<int> order;       ///< [n], every parent before its children
};

/// The skeleton's own tree: joints as they are numbered, bone lengths as edges; a forest is joined by connected().
MetricTree bone_tree(const JointTree& forest);

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

/// The quadratic program behind (fused) Gromov–Wasserstein, in whole units of mass:
///   objective(X) = <linear, X> - curvature * <C1 X C2, X>,
/// minimised over X >= 0 with row sums `supplies` and column sums `demands`. For square loss
///   cost(X / total) = constant + objective(X) / total,
/// since the squares of the distances meet only the marginals (Peyré, Cuturi and Solomon 2016, proposition 1). For
/// tree metrics the objective is concave, so vertices are optimal.
struct GwProblem {
  RowMatrix c1, c2;                        ///< [n,n], [m,m] symmetric, zero diagonal
  std::optional<MetricTree> tree1, tree2;  ///< when the matrices are tree geodesics: products take O(n m)
  MassUnits units;
  RowMatrix linear;        ///< [n,m], or empty for zero
  double curvature = 0.0;  ///< 2 alpha / total, alpha = 1 without a linear part

  int rows() const { return static_cast<int>(c1.rows()); }
  int columns() const { return static_cast<int>(c2.rows()); }

  /// linear - 2 curvature C1 X C2. [n,m]
  RowMatrix gradient(const std::vector<PlanCell>& cells) const;
  /// <linear, X> + <gradient(X), X>, halved.
  double objective(const std::vector<PlanCell>& cells, const RowMatrix& gradient) const;
  double objective(const std::vector<PlanCell>& cells) const { return objective(cells, gradient(cells)); }
  /// True when a coupling has few enough cells (a vertex has n + m - 1 at most) for work on all pairs of them.
  bool sparse(std::size_t cells) const { return cells <= 4 * static_cast<std::size_t>(rows() + columns()); }
  /// Changes of the objective below this are rounding.
  double resolution() const;
};

/// sum over pairs of cells of (C1 - C2)^2 X X, summed directly: never negative, and exactly 0 for an isometry.
/// Costs the square of the number of cells. @param cells with masses that sum to 1
double gw_cost(const RowMatrix& c1, const RowMatrix& c2, const std::vector<PlanCell>& cells);

/// As above, for a dense coupling, by three matrix products; rounding may leave a tiny negative number, which is
/// returned as 0. @param plan [n,m]
double gw_cost(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::MatrixXd& plan);

/// Input of canonical_order for one tree.
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

}  // namespace anigen::metrics
