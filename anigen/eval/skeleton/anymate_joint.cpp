#include "anigen/eval/skeleton/anymate_joint.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

constexpr double kEpsilon = 1e-4, kStop = 1e-3;
constexpr int kIterations = 100;
constexpr double kLargestCost = 1.6e7;  // 128 MB
// exp of less than this below the largest term cannot change a sum of doubles, and most terms are.
constexpr double kNegligible = -45.0;

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

RowMajor distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  if (static_cast<double>(a.size()) * static_cast<double>(b.size()) > kLargestCost)
    throw InputError("", "joints", "too many joints on both sides");
  RowMajor cost(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k)
      cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = (a[i] - b[k]).norm();
  }
  return cost;
}

/// potential_i ← ε (ln mass − LSE_k((other_k − cost_ik)/ε)) for every row. @return Σ |change|
double update(const RowMajor& cost, const Eigen::VectorXd& other, double log_mass, Eigen::VectorXd& potential) {
  double change = 0;
  Eigen::VectorXd scaled(cost.cols());
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    scaled = (other - cost.row(i).transpose()) / kEpsilon;
    const double largest = scaled.maxCoeff();
    double sum = 0;
    for (Eigen::Index k = 0; k < scaled.size(); ++k) {
      if (scaled[k] - largest > kNegligible) sum += std::exp(scaled[k] - largest);
    }
    const double next = kEpsilon * (log_mass - (largest + std::log(sum)));
    change += std::abs(next - potential[i]);
    potential[i] = next;
  }
  return change;
}

ReleasedEmd released_emd(const RowMajor& cost) {
  const RowMajor transposed = cost.transpose();
  Eigen::VectorXd u = Eigen::VectorXd::Zero(cost.rows()), v = Eigen::VectorXd::Zero(cost.cols());
  const double log_a = -std::log(static_cast<double>(cost.rows())), log_b = -std::log(static_cast<double>(cost.cols()));
  ReleasedEmd result;
  while (result.iterations < kIterations) {
    const double u_change = update(cost, v, log_a, u), v_change = update(transposed, u, log_b, v);
    ++result.iterations;
    if (u_change < kStop && v_change < kStop) break;
  }
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    for (Eigen::Index k = 0; k < cost.cols(); ++k) {
      const double mass = std::exp((u[i] + v[k] - cost(i, k)) / kEpsilon);
      result.plan_mass += mass;
      result.cost += mass * cost(i, k);
    }
  }
  return result;
}

}  // namespace

ReleasedEmd anymate_emd(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth) {
  if (predicted.empty() || truth.empty()) throw InputError("", "joints", "a skeleton has no joint");
  return released_emd(distances(predicted, truth));
}

AnymateJointScore anymate_joint(const std::vector<Eigen::Vector3d>& predicted,
                                const std::vector<Eigen::Vector3d>& truth, double threshold) {
  if (truth.empty()) throw InputError("", "joints", "the ground truth has no joint");
  AnymateJointScore score;
  if (predicted.size() < 2) {
    score.not_computed = "fewer than 2 predicted joints, which the published evaluation leaves out";
    return score;
  }
  const RowMajor cost = distances(predicted, truth);
  const Eigen::ArrayXd to_truth = cost.rowwise().minCoeff(), to_predicted = cost.colwise().minCoeff().transpose();
  score.cd = 0.5 * (to_truth.mean() + to_predicted.mean());
  score.precision = (to_truth < threshold).cast<double>().mean();
  score.recall = (to_predicted < threshold).cast<double>().mean();
  score.emd = released_emd(cost);
  return score;
}

}  // namespace anigen::eval
