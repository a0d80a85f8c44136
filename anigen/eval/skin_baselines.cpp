#include "anigen/eval/skin_baselines.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "anigen/geometry/bones.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::eval {

std::vector<float> nearest_bone_weights(const GroundTruth& truth) {
  const auto segments = geometry::bone_segments(truth.joints, truth.parents);
  const std::vector<std::size_t> nearest = geometry::nearest_moving_joints(truth.vertices, segments);
  std::vector<float> weights(truth.vertex_count() * truth.joint_count(), 0.0f);
  for (std::size_t v = 0; v < nearest.size(); ++v) weights[v * truth.joint_count() + nearest[v]] = 1.0f;
  return weights;
}

std::vector<float> inverse_distance_weights(const GroundTruth& truth, double power) {
  const auto segments = geometry::bone_segments(truth.joints, truth.parents);
  const std::size_t joints = truth.joint_count();
  std::vector<float> weights(truth.vertex_count() * joints);
  std::vector<double> row(joints);
  for (std::size_t v = 0; v < truth.vertex_count(); ++v) {
    double nearest = 1e300, sum = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      row[j] = geometry::distance(truth.vertices[v], segments[j]) + 1e-6;
      nearest = std::min(nearest, row[j]);
    }
    // Relative to the nearest bone, no power overflows.
    for (double& w : row) sum += w = std::pow(nearest / w, power);
    for (std::size_t j = 0; j < joints; ++j) weights[v * joints + j] = static_cast<float>(row[j] / sum);
  }
  return weights;
}

std::vector<float> strongest_joint_weights(const GroundTruth& truth) {
  const std::size_t joints = truth.joint_count();
  std::vector<float> weights(truth.skin.size(), 0.0f);
  for (std::size_t v = 0; v < truth.vertex_count(); ++v) {
    const auto row = truth.skin.begin() + static_cast<std::ptrdiff_t>(v * joints);
    weights[v * joints +
            static_cast<std::size_t>(std::max_element(row, row + static_cast<std::ptrdiff_t>(joints)) - row)] = 1.0f;
  }
  return weights;
}

std::vector<SkinMethod> skin_baselines() {
  const auto geometric = [](const std::string& key, const std::string& label, auto function) {
    return SkinMethod{key, label,
                      [function](const io::DatasetItem&, const GroundTruth& truth) { return function(truth); }};
  };
  std::vector<SkinMethod> methods = {
      geometric("nearest_bone", "nearest bone", nearest_bone_weights),
      geometric("inverse_distance", "inverse distance, power 8",
                [](const GroundTruth& t) { return inverse_distance_weights(t); }),
      geometric("strongest_joint", "strongest true joint (oracle)", strongest_joint_weights),
      geometric("rank4", "best rank 4 (oracle)", [](const GroundTruth& t) { return low_rank_weights(t); }),
      geometric("mixture4", "mixture of 4 rows (oracle)", [](const GroundTruth& t) { return mixture_weights(t); })};
  for (std::size_t i = 2; i < methods.size(); ++i) methods[i].oracle = true;
  return methods;
}

namespace {

using Rows = metrics::SkinMatrix;

/// The non-zero entries of the true weights, row by row: weights are sparse, so fitting only visits these.
struct SparseRows {
  std::vector<std::size_t> offsets{0};
  std::vector<std::size_t> joints;
  std::vector<double> weights;
};

SparseRows sparse_rows(const GroundTruth& truth) {
  SparseRows sparse;
  for (std::size_t v = 0; v < truth.vertex_count(); ++v) {
    for (std::size_t j = 0; j < truth.joint_count(); ++j) {
      const float w = truth.skin[v * truth.joint_count() + j];
      if (w <= 0.0f) continue;
      sparse.joints.push_back(j);
      sparse.weights.push_back(w);
    }
    sparse.offsets.push_back(sparse.joints.size());
  }
  return sparse;
}

Rows dense_rows(const GroundTruth& truth) {
  return metrics::skin_matrix(truth.skin, truth.vertex_count(), truth.joint_count());
}

/// Rows of W that are far from each other, mixed with a little of the mean row so that no entry starts at 0, where
/// expectation–maximisation would keep it.
Rows farthest_rows(const Rows& weights, std::size_t rank) {
  const Eigen::RowVectorXd mean = weights.colwise().mean();
  Rows basis(static_cast<Eigen::Index>(rank), weights.cols());
  Eigen::VectorXd nearest = (weights.rowwise() - mean).cwiseAbs().rowwise().sum();
  for (Eigen::Index k = 0; k < basis.rows(); ++k) {
    Eigen::Index farthest = 0;
    nearest.maxCoeff(&farthest);
    const Eigen::RowVectorXd chosen = weights.row(farthest);
    const Eigen::VectorXd gap = (weights.rowwise() - chosen).cwiseAbs().rowwise().sum();
    nearest = k == 0 ? gap : Eigen::VectorXd(nearest.cwiseMin(gap));
    basis.row(k) = 0.8 * chosen + 0.2 * mean;
  }
  return basis;
}

}  // namespace

std::vector<float> low_rank_weights(const GroundTruth& truth, std::size_t rank) {
  const Rows weights = dense_rows(truth);
  const Eigen::Index joints = weights.cols(), kept = std::min(static_cast<Eigen::Index>(rank), joints);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(weights.transpose() * weights);
  const Eigen::MatrixXd leading = solver.eigenvectors().rightCols(kept);  // eigenvalues come in increasing order
  const Rows approximation = (weights * leading) * leading.transpose();
  std::vector<float> result(truth.skin.size(), 0.0f);
  for (Eigen::Index v = 0; v < weights.rows(); ++v) {
    float* row = result.data() + v * joints;
    const double sum = approximation.row(v).cwiseMax(0.0).sum();
    if (sum > 0.0) {
      for (Eigen::Index j = 0; j < joints; ++j) row[j] = static_cast<float>(std::max(0.0, approximation(v, j)) / sum);
    } else {
      Eigen::Index largest = 0;
      approximation.row(v).maxCoeff(&largest);
      row[largest] = 1.0f;
    }
  }
  return result;
}

std::vector<float> mixture_weights(const GroundTruth& truth, std::size_t rank, std::size_t iterations) {
  const std::size_t joints = truth.joint_count(), vertices = truth.vertex_count();
  if (rank >= joints) return truth.skin;
  const SparseRows sparse = sparse_rows(truth);
  Rows basis;
  Rows mix = Rows::Constant(static_cast<Eigen::Index>(vertices), static_cast<Eigen::Index>(rank),
                            1.0 / static_cast<double>(rank));
  {
    const Rows weights = dense_rows(truth);
    basis = farthest_rows(weights, rank);
    for (Eigen::Index k = 0; k < basis.rows(); ++k)
      mix.col(k) = ((weights.rowwise() - basis.row(k)).cwiseAbs().rowwise().sum().array() + 0.1).inverse();
    mix.array().colwise() /= mix.rowwise().sum().array().eval();
  }
  const auto r = static_cast<Eigen::Index>(rank);
  Eigen::RowVectorXd share(r);
  // Weights as a mixture of k rows: w_vj ≈ p(j|v) = Σ_k p(k|v) p(j|k), with mix = p(k|v) and basis = p(j|k).
  for (std::size_t step = 0; step < iterations; ++step) {
    Rows next = Rows::Zero(r, static_cast<Eigen::Index>(joints));
    for (std::size_t v = 0; v < vertices; ++v) {
      const auto row = static_cast<Eigen::Index>(v);
      Eigen::RowVectorXd mixed = Eigen::RowVectorXd::Zero(r);
      for (std::size_t i = sparse.offsets[v]; i < sparse.offsets[v + 1]; ++i) {
        const auto j = static_cast<Eigen::Index>(sparse.joints[i]);
        // E step: p(k|v,j) = p(k|v) p(j|k) / Σ_k p(k|v) p(j|k), times w_vj.
        share = mix.row(row).cwiseProduct(basis.col(j).transpose());
        const double sum = share.sum();
        if (!(sum > 0.0)) continue;
        share *= sparse.weights[i] / sum;
        // M step: p(k|v) ∝ Σ_j w_vj p(k|v,j), and p(j|k) ∝ Σ_v w_vj p(k|v,j).
        mixed += share;
        next.col(j) += share.transpose();
      }
      if (mixed.sum() > 0.0) mix.row(row) = mixed / mixed.sum();
    }
    for (Eigen::Index k = 0; k < r; ++k) {
      if (next.row(k).sum() > 0.0) basis.row(k) = next.row(k) / next.row(k).sum();
    }
  }
  std::vector<float> result(truth.skin.size());
  for (std::size_t v = 0; v < vertices; ++v) {
    const Eigen::RowVectorXd row = mix.row(static_cast<Eigen::Index>(v)) * basis;
    Eigen::Map<Eigen::RowVectorXf>(result.data() + v * joints, row.size()) = (row / row.sum()).cast<float>();
  }
  return result;
}

}  // namespace anigen::eval
