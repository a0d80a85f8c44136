#include "anigen/metrics/skin_metrics.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::metrics {

namespace {

void check_size(std::size_t found, std::size_t vertices, std::size_t joints) {
  if (joints != 0 && vertices > static_cast<std::size_t>(-1) / joints)
    throw InputError("", "skin", "too many vertices and joints");
  if (found != vertices * joints) {
    throw InputError("", "skin",
                     std::to_string(found) + " weights for " + std::to_string(vertices) + " vertices and " +
                         std::to_string(joints) + " joints");
  }
}

void check_entries(const SkinMatrixView& weights, const char* which) {
  for (Eigen::Index v = 0; v < weights.rows(); ++v) {
    // Written so that NaN fails too.
    if (weights.row(v).minCoeff() >= 0.0 && weights.row(v).allFinite()) continue;
    throw InputError("", std::string(which) + ", vertex " + std::to_string(v), "a weight is negative or not finite");
  }
}

/// diag(1/a) π, checked.
SkinMatrix shares(const Eigen::MatrixXd& plan) {
  if (plan.size() == 0) throw InputError("", "transport plan", "there is no joint");
  if (!plan.allFinite() || plan.minCoeff() < 0.0)
    throw InputError("", "transport plan", "an entry is negative or not finite");
  SkinMatrix result = plan;
  for (Eigen::Index j = 0; j < plan.rows(); ++j) {
    const double mass = result.row(j).sum();
    if (!(mass > 0.0))
      throw InputError("", "transport plan", "predicted joint " + std::to_string(j) + " is not transported anywhere");
    result.row(j) /= mass;
  }
  return result;
}

void add(SkinScore& sum, const SkinScore& term) {
  sum.l1 += term.l1;
  sum.l2 += term.l2;
  sum.kl += term.kl;
}

void divide(SkinScore& sum, std::size_t n) {
  if (n == 0) return;
  sum.l1 /= static_cast<double>(n);
  sum.l2 /= static_cast<double>(n);
  sum.kl /= static_cast<double>(n);
}

constexpr double kCosineEpsilon = 1e-6, kEntropyEpsilon = 1e-6, kClampMargin = 1e-3;
constexpr double kLeastWeight = 1e-3, kSumEpsilon = 1e-10, kSumTolerance = 1e-2;
constexpr double kBatchKlFloor = 1e-8, kElementKlEpsilon = 1e-10;

struct Sets {
  double predicted = 0, truth = 0, both = 0;
};

template <typename Influences>
Sets count(const SkinMatrixView& predicted, const SkinMatrixView& truth, Eigen::Index v, Influences influences) {
  Sets sets;
  for (Eigen::Index j = 0; j < truth.cols(); ++j) {
    const bool p = influences(predicted(v, j)), t = influences(truth(v, j));
    sets.predicted += p;
    sets.truth += t;
    sets.both += p && t;
  }
  return sets;
}

double cosine(const Eigen::ArrayXd& a, const Eigen::ArrayXd& b) {
  const double norms = std::max(a.matrix().norm(), kCosineEpsilon) * std::max(b.matrix().norm(), kCosineEpsilon);
  return (a * b).sum() / norms;
}

/// t ln(t / p), 0 for t = 0.
double divergence(double t, double p) { return t > 0.0 ? t * std::log(t / p) : 0.0; }

/// @throws InputError unless both have the same shape, at least one vertex and one joint, and finite entries ≥ 0
void check_skin_pair(const SkinMatrixView& predicted, const SkinMatrixView& truth) {
  if (predicted.rows() != truth.rows() || predicted.cols() != truth.cols()) {
    throw InputError("", "skin",
                     "predicted weights are " + std::to_string(predicted.rows()) + " x " +
                         std::to_string(predicted.cols()) + ", true ones " + std::to_string(truth.rows()) + " x " +
                         std::to_string(truth.cols()));
  }
  if (truth.size() == 0) throw InputError("", "skin", "there is no vertex or no joint");
  check_entries(predicted, "predicted skin");
  check_entries(truth, "true skin");
}

}  // namespace

Eigen::Map<const SkinMatrix> skin_matrix(const std::vector<double>& dense, std::size_t vertices, std::size_t joints) {
  check_size(dense.size(), vertices, joints);
  return {dense.data(), static_cast<Eigen::Index>(vertices), static_cast<Eigen::Index>(joints)};
}

SkinMatrix skin_matrix(const std::vector<float>& dense, std::size_t vertices, std::size_t joints) {
  check_size(dense.size(), vertices, joints);
  using Single = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Single>(dense.data(), static_cast<Eigen::Index>(vertices), static_cast<Eigen::Index>(joints))
      .cast<double>();
}

std::vector<double> matched_weights(const SkinWeights& predicted_on_truth, const Eigen::MatrixXd& plan) {
  const SkinMatrix share = shares(plan);
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

std::vector<float> single_precision(const std::vector<double>& weights) { return {weights.begin(), weights.end()}; }

std::vector<int> strongest_match(const Eigen::MatrixXd& plan) {
  const SkinMatrix share = shares(plan);
  std::vector<int> best(static_cast<std::size_t>(share.rows()));
  for (Eigen::Index j = 0; j < share.rows(); ++j) share.row(j).maxCoeff(&best[at(j)]);
  return best;
}

SkinScores score_skin(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                      std::size_t joints) {
  SkinScores scores;
  for (std::size_t v = 0; v < vertices; ++v) {
    const float* p = predicted.data() + v * joints;
    const float* t = truth.data() + v * joints;
    SkinScore row;
    double squares = 0;
    std::size_t influences = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      const double difference = static_cast<double>(p[j]) - t[j];
      row.l1 += std::abs(difference);
      squares += difference * difference;
      if (t[j] <= 0.0f) continue;
      ++influences;
      row.kl += t[j] * std::log((t[j] + kKlEpsilon) / (p[j] + kKlEpsilon));
    }
    row.l2 = std::sqrt(squares);
    add(scores.mean, row);
    if (influences == 0) continue;
    const std::size_t group = std::min(influences, kInfluenceClasses) - 1;
    add(scores.by_influences[group], row);
    ++scores.class_sizes[group];
  }
  divide(scores.mean, vertices);
  for (std::size_t k = 0; k < kInfluenceClasses; ++k) divide(scores.by_influences[k], scores.class_sizes[k]);
  return scores;
}

std::vector<float> vertex_l1(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                             std::size_t joints) {
  std::vector<float> result(vertices, 0.0f);
  for (std::size_t v = 0; v < vertices; ++v) {
    for (std::size_t i = v * joints; i < (v + 1) * joints; ++i) result[v] += std::abs(predicted[i] - truth[i]);
  }
  return result;
}

std::size_t normalize_rows(std::vector<float>& dense, std::size_t rows, std::size_t joints, const std::string& file) {
  std::size_t off = 0;
  for (std::size_t v = 0; v < rows; ++v) {
    float* row = dense.data() + v * joints;
    double sum = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      if (!std::isfinite(row[j]) || row[j] < 0.0f) {
        throw InputError(file, "skin[" + std::to_string(v) + ", " + std::to_string(j) + "]",
                         "a weight must be finite and not negative, got " + std::to_string(row[j]));
      }
      sum += row[j];
    }
    if (!(sum > 0.0)) throw InputError(file, "skin[" + std::to_string(v) + "]", "the row has no weight at all");
    off += std::abs(sum - 1.0) > 1e-3;
    for (std::size_t j = 0; j < joints; ++j) row[j] = static_cast<float>(row[j] / sum);
  }
  return off;
}

AnymateSkinScore anymate_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth, double threshold) {
  check_skin_pair(predicted, truth);
  const auto vertices = static_cast<double>(truth.rows());
  AnymateSkinScore score;
  double cosines = 0, clamped_cosines = 0;
  for (Eigen::Index v = 0; v < truth.rows(); ++v) {
    const Eigen::ArrayXd p = predicted.row(v).transpose().array(), t = truth.row(v).transpose().array();
    cosines += cosine(p, t);
    clamped_cosines += cosine((p * (1.0 + 2.0 * kClampMargin) - kClampMargin).max(0.0).min(1.0), t);
    score.cross_entropy -= (t * (p + kEntropyEpsilon).log()).sum();
    score.mean_l1 += (p - t).abs().sum();
    const Sets sets = count(predicted, truth, v, [threshold](double w) { return w >= threshold; });
    if (sets.predicted == 0 || sets.truth == 0) continue;
    score.overlap.precision += sets.both / sets.predicted;
    score.overlap.recall += sets.both / sets.truth;
  }
  score.cos_loss = 1.0 - cosines / vertices;
  score.cos_clamp_loss = 1.0 - clamped_cosines / vertices;
  score.cross_entropy /= vertices;
  score.mean_l1 /= vertices;
  score.mae = score.mean_l1 / static_cast<double>(truth.cols());
  score.overlap.precision /= vertices;
  score.overlap.recall /= vertices;
  return score;
}

SkinMatrix puppeteer_filtered(const SkinMatrixView& predicted, double filter) {
  SkinMatrix result = predicted;
  if (result.size() == 0) return result;
  for (Eigen::Index v = 0; v < result.rows(); ++v) {
    auto row = result.row(v).array();
    row = (row < kLeastWeight).select(0.0, row);
    const double bound = row.maxCoeff() * filter;
    row = (row < bound).select(0.0, row);
    row /= row.sum() + kSumEpsilon;
  }
  return result;
}

PuppeteerSkinScore puppeteer_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth, double filter) {
  check_skin_pair(predicted, truth);
  const SkinMatrix filtered = puppeteer_filtered(predicted, filter);
  PuppeteerSkinScore score;
  Sets all;
  for (Eigen::Index v = 0; v < truth.rows(); ++v) {
    if (!(std::abs(truth.row(v).sum() - 1.0) < kSumTolerance)) continue;
    ++score.kept;
    const Sets sets = count(filtered, truth, v, [](double w) { return w > 0.0; });
    all.predicted += sets.predicted;
    all.truth += sets.truth;
    all.both += sets.both;
    score.l1 += (filtered.row(v) - truth.row(v)).lpNorm<1>();
  }
  score.overlap.precision = all.both / (all.predicted + kSumEpsilon);
  score.overlap.recall = all.both / (all.truth + kSumEpsilon);
  if (score.kept > 0) score.l1 /= static_cast<double>(score.kept);
  return score;
}

SkinOverlap rignet_skin_overlap(const SkinMatrixView& predicted, const SkinMatrixView& truth, double threshold) {
  check_skin_pair(predicted, truth);
  SkinOverlap overlap;
  for (Eigen::Index v = 0; v < truth.rows(); ++v) {
    const Sets sets = count(predicted, truth, v, [threshold](double w) { return w > threshold; });
    if (sets.predicted > 0) overlap.precision += sets.both / sets.predicted;
    if (sets.truth > 0) overlap.recall += sets.both / sets.truth;
  }
  overlap.precision /= static_cast<double>(truth.rows());
  overlap.recall /= static_cast<double>(truth.rows());
  return overlap;
}

PlainSkinScore plain_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth) {
  check_skin_pair(predicted, truth);
  const auto vertices = static_cast<double>(truth.rows()), entries = static_cast<double>(truth.size());
  PlainSkinScore score;
  double l1 = 0, squares = 0, elements = 0;
  for (Eigen::Index v = 0; v < truth.rows(); ++v) {
    const double sum = truth.row(v).sum();
    for (Eigen::Index j = 0; j < truth.cols(); ++j) {
      const double p = predicted(v, j), t = truth(v, j), d = std::abs(p - t);
      l1 += d;
      squares += d * d;
      score.max_abs = std::max(score.max_abs, d);
      if (sum > 0.0) score.kl_batch_mean += divergence(t / sum, std::max(p, kBatchKlFloor));
      elements += divergence(t, p + kElementKlEpsilon);
    }
  }
  score.l1_mean = l1 / entries;
  score.l2_mean = squares / entries;
  score.l1_per_vertex = l1 / vertices;
  score.kl_batch_mean /= vertices;
  score.kl_element_mean = elements / entries;
  return score;
}

}  // namespace anigen::metrics
