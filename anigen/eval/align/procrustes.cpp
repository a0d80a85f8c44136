#include "anigen/eval/align/procrustes.h"

#include <Eigen/SVD>
#include <cmath>
#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {

void ProcrustesSums::add(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double weight) {
  if (empty_) {
    from_origin_ = from;
    to_origin_ = to;
    empty_ = false;
  }
  const Eigen::Vector3d a = from - from_origin_, b = to - to_origin_;
  weight_ += weight;
  from_ += weight * a;
  to_ += weight * b;
  from_squared_ += weight * a.squaredNorm();
  to_squared_ += weight * b.squaredNorm();
  cross_ += weight * a * b.transpose();
}

Similarity ProcrustesSums::solve(PairScale scale) const {
  if (!(weight_ > 0.0)) throw InputError("", "pairs", "there is nothing to align: no pair has a positive weight");
  const Eigen::Vector3d from_mean = from_ / weight_, to_mean = to_ / weight_;
  const Eigen::Matrix3d covariance = cross_ / weight_ - from_mean * to_mean.transpose();
  const double from_variance = from_squared_ / weight_ - from_mean.squaredNorm();
  const double to_variance = to_squared_ / weight_ - to_mean.squaredNorm();

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if ((svd.matrixV() * svd.matrixU().transpose()).determinant() < 0.0) sign.z() = -1.0;
  Similarity result;
  result.rotation = svd.matrixV() * sign.asDiagonal() * svd.matrixU().transpose();
  double found = 1.0;
  if (scale == PairScale::kLeastSquares) found = svd.singularValues().dot(sign) / from_variance;
  if (scale == PairScale::kSizeRatio) found = std::sqrt(to_variance / from_variance);
  if (std::isfinite(found) && found > 0.0) result.scale = found;
  result.translation = to_origin_ + to_mean - result.scale * (result.rotation * (from_origin_ + from_mean));
  return result;
}

Similarity procrustes(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to, PairScale scale,
                      const std::vector<double>& weights) {
  if (from.size() != to.size() || (!weights.empty() && weights.size() != from.size())) {
    throw InputError("", "pairs",
                     std::to_string(from.size()) + " points cannot be paired with " + std::to_string(to.size()) +
                         " points and " + std::to_string(weights.size()) + " weights");
  }
  ProcrustesSums sums;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double weight = weights.empty() ? 1.0 : weights[i];
    if (!from[i].allFinite() || !to[i].allFinite() || !(weight >= 0.0) || !std::isfinite(weight)) {
      throw InputError("", "pairs[" + std::to_string(i) + "]", "a position or weight is not finite or negative");
    }
    sums.add(from[i], to[i], weight);
  }
  return sums.solve(scale);
}

}  // namespace anigen::eval
