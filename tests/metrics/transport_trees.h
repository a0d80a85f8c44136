#pragma once
#include <Eigen/Core>
#include <numeric>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/core/random.h"

namespace anigen::test {

/// A random skeleton of `joints` joints: each hangs on the one before or on any earlier one.
inline JointTree random_tree(std::size_t joints, Rng& rng) {
  JointTree tree;
  for (std::size_t j = 0; j < joints; ++j) {
    const std::size_t parent = j == 0 ? 0 : (rng.chance(0.5) ? j - 1 : rng.index(j));
    const Eigen::Vector3d step(rng.normal(), rng.normal(), rng.normal());
    tree.parents.push_back(j == 0 ? -1 : static_cast<int>(parent));
    tree.positions.push_back(j == 0 ? Eigen::Vector3d(0.0, 0.0, 0.0) : Eigen::Vector3d(tree.positions[parent] + step));
  }
  return tree;
}

/// Skeleton with its joints in another order.
inline JointTree relabelled(const JointTree& tree, Rng& rng) {
  const std::vector<std::size_t> place = rng.permutation(tree.size());  // joint j moves to place[j]
  JointTree result = tree;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    result.positions[place[j]] = tree.positions[j];
    result.parents[place[j]] =
        tree.parents[j] < 0 ? -1 : static_cast<int>(place[static_cast<std::size_t>(tree.parents[j])]);
  }
  return result;
}

/// Masses that sum to 1, all different, some small.
inline Eigen::VectorXd random_masses(std::size_t n, Rng& rng) {
  Eigen::VectorXd masses(static_cast<Eigen::Index>(n));
  for (double& mass : masses) mass = rng.uniform(0.01, 1.0);
  return masses / masses.sum();
}

inline Eigen::MatrixXd random_matrix(std::size_t n, std::size_t m, Rng& rng) {
  Eigen::MatrixXd matrix(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(m));
  for (double& value : matrix.reshaped()) value = rng.uniform();
  return matrix;
}

inline double marginal_error(const Eigen::MatrixXd& plan, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  return (plan.rowwise().sum() - a).cwiseAbs().sum() + (plan.colwise().sum().transpose() - b).cwiseAbs().sum();
}

}  // namespace anigen::test
