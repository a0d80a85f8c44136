#include "anigen/eval/skeleton/anymate_connectivity.h"

#include <string>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

void check_input(const Eigen::MatrixXd& matrix, Eigen::Index joints, const char* which) {
  if (matrix.rows() != joints || matrix.cols() != joints || joints == 0) {
    throw InputError("", which,
                     "expected a square matrix of all joints, found " + std::to_string(matrix.rows()) + " x " +
                         std::to_string(matrix.cols()));
  }
  if (!matrix.allFinite() || matrix.minCoeff() < 0.0) throw InputError("", which, "an entry is negative or not finite");
}

/// The largest entry of every row without the diagonal (which counts as 0).
std::vector<Eigen::Index> best_other_joint(Eigen::MatrixXd matrix) {
  matrix.diagonal().setZero();
  std::vector<Eigen::Index> best(static_cast<std::size_t>(matrix.rows()), 0);
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    Eigen::Index& k = best[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 1; j < matrix.cols(); ++j) {
      if (matrix(i, j) > matrix(i, k)) k = j;
    }
  }
  return best;
}

bool linked(const std::vector<Eigen::Index>& parents, Eigen::Index a, Eigen::Index b) {
  return parents[static_cast<std::size_t>(a)] == b || parents[static_cast<std::size_t>(b)] == a;
}

}  // namespace

Eigen::VectorXd anymate_cross_entropy(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth) {
  check_input(predicted, truth.rows(), "predicted connectivity");
  check_input(truth, truth.rows(), "true connectivity");
  return -(truth.array() * (predicted.array() + 1e-6).log()).rowwise().sum();
}

AnymateConnectivityScore anymate_connectivity(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth) {
  AnymateConnectivityScore score;
  score.cross_entropy = anymate_cross_entropy(predicted, truth).mean();
  const std::vector<Eigen::Index> guess = best_other_joint(predicted), parent = best_other_joint(truth);
  double right = 0, wrong = 0, missed = 0;
  for (Eigen::Index i = 0; i < truth.rows(); ++i) {
    const bool found = linked(parent, i, guess[static_cast<std::size_t>(i)]);
    right += found;
    wrong += !found;
    missed += !linked(guess, i, parent[static_cast<std::size_t>(i)]);
  }
  score.precision = right / (right + wrong);
  score.recall = right + missed > 0 ? right / (right + missed) : 0.0;
  return score;
}

}  // namespace anigen::eval
