#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// The cells of a 64³ grid over [-1, 1]³ that lie inside the mesh (Anymate's `vox`).
class AnymateOccupancy {
 public:
  static constexpr int kResolution = 64;

  /// @param cells [V], each index in [0, 64) @throws InputError naming the cell
  explicit AnymateOccupancy(const std::vector<std::array<int, 3>>& cells);
  /// The cell round(32 p + 32) per axis, half to even, clipped to the grid.
  bool contains(const Eigen::Vector3d& p) const;

 private:
  std::vector<char> inside_;
};

/// A skeleton from probabilities of parents (reference anymate-baselines.md, 6.3), RigNet's procedure as Anymate
/// carries it: every step as published, deviations from the textbook included.
struct AnymateTree {
  io::JointTree tree;    ///< one root; a joint that no edge of positive cost reaches also becomes a root
  int root = 0;          ///< largest entry of the diagonal, the first of equals
  Eigen::MatrixXd cost;  ///< [J, J] before the tree was grown
};

/// @param joints [J], in [-1, 1]³ @param parents [J, J]: row i holds the probabilities of i's parents, the diagonal
///        that of being the root; finite, not negative
/// @throws InputError for no joint, another shape, or entries out of range
AnymateTree grow_anymate_tree(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                              const AnymateOccupancy& inside);

/// −ln of the row-normalised probabilities without their diagonal, then bones with more than one sample (every 0.01)
/// outside the mesh cost twice the number of those samples, and half of it all between joints of the middle plane.
Eigen::MatrixXd anymate_bone_costs(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                                   const AnymateOccupancy& inside);

/// Prim's algorithm from `root`; a joint's bones that fold back along the bone to its parent are made expensive once
/// the joint is in the tree. The cost of edge (u, v) is read at [u, v], u in the tree: for a matrix whose rows are
/// children that is the transposed entry, as published. @return [J] parents, -1 for the root and unreachable joints
std::vector<int> anymate_parents(const std::vector<Eigen::Vector3d>& joints, Eigen::MatrixXd cost, int root);

}  // namespace anigen::eval
