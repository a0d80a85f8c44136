#pragma once
#include <Eigen/Core>

namespace anigen::eval {

/// Anymate's connectivity metrics on the true joints (reference anymate-baselines.md, 6.2).
struct AnymateConnectivityScore {
  double cross_entropy = 0;  ///< mean over rows of −Σ y ln(p + 1e-6), diagonals included
  double precision = 0, recall = 0;
};

/// Rows are joints, columns their possible parents; a root points at itself. As published, the parents that precision
/// and recall compare are the largest entries of matrices whose diagonals were set to 0 (a side effect of building the
/// skeleton first): a predicted root gets its best other joint, a true root joint 0. Then, with symmetric adjacency A:
/// precision = share of joints i with A_true[i, predicted parent of i]; recall = TP / (TP + FN), where TP is the count
/// of precision and FN counts joints i without A_predicted[i, true parent of i]. The first of equal entries counts.
/// @param predicted probabilities [J, J] @param truth one-hot rows [J, J]
/// @throws InputError for other shapes, no joints, or entries that are negative or not finite
AnymateConnectivityScore anymate_connectivity(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth);

/// −Σ_k y_ik ln(p_ik + 1e-6), [J].
Eigen::VectorXd anymate_cross_entropy(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth);

}  // namespace anigen::eval
