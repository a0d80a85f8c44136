#include "anigen/eval/skin/skin_matching.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// diag(1/a) π, checked.
RowMajor shares(const Eigen::MatrixXd& plan) {
  if (plan.size() == 0) throw InputError("", "transport plan", "there is no joint");
  if (!plan.allFinite() || plan.minCoeff() < 0.0)
    throw InputError("", "transport plan", "an entry is negative or not finite");
  RowMajor result = plan;
  for (Eigen::Index j = 0; j < plan.rows(); ++j) {
    const double mass = result.row(j).sum();
    if (!(mass > 0.0))
      throw InputError("", "transport plan", "predicted joint " + std::to_string(j) + " is not transported anywhere");
    result.row(j) /= mass;
  }
  return result;
}

}  // namespace

std::vector<double> matched_weights(const SkinWeights& predicted_on_truth, const Eigen::MatrixXd& plan) {
  const RowMajor share = shares(plan);
  const auto joints = static_cast<std::size_t>(share.cols());
  std::vector<double> result(predicted_on_truth.rows() * joints, 0.0);
  for (std::size_t v = 0; v < predicted_on_truth.rows(); ++v) {
    Eigen::Map<Eigen::RowVectorXd> row(result.data() + v * joints, share.cols());
    for (std::size_t i = 0; i < predicted_on_truth.row_size(v); ++i) {
      const Influence& influence = predicted_on_truth.row(v)[i];
      if (influence.joint < 0 || influence.joint >= share.rows()) {
        throw InputError("", "skin row " + std::to_string(v),
                         "joint " + std::to_string(influence.joint) + " of " + std::to_string(share.rows()));
      }
      row += static_cast<double>(influence.weight) * share.row(influence.joint);
    }
    if (predicted_on_truth.row_size(v) == 0) {
      row = share.row(0);
      continue;
    }
    // Weights in single precision sum to 1 only to 1e-7.
    const double sum = row.sum();
    if (!(sum > 0.0)) throw InputError("", "skin row " + std::to_string(v), "its weights do not sum to 1");
    row /= sum;
  }
  return result;
}

std::vector<float> single_precision(const std::vector<double>& weights) {
  std::vector<float> result(weights.size());
  for (std::size_t i = 0; i < weights.size(); ++i) result[i] = static_cast<float>(weights[i]);
  return result;
}

std::vector<int> strongest_match(const Eigen::MatrixXd& plan) {
  const RowMajor share = shares(plan);
  std::vector<int> best(static_cast<std::size_t>(share.rows()), 0);
  for (Eigen::Index j = 0; j < share.rows(); ++j) {
    int& k = best[static_cast<std::size_t>(j)];
    for (int other = 1; other < static_cast<int>(share.cols()); ++other) {
      if (share(j, other) > share(j, k)) k = other;
    }
  }
  return best;
}

}  // namespace anigen::eval
