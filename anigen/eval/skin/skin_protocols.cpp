#include "anigen/eval/skin/skin_protocols.h"

#include <algorithm>
#include <cmath>

namespace anigen::eval {
namespace {

constexpr double kCosineEpsilon = 1e-6, kEntropyEpsilon = 1e-6, kClampMargin = 1e-3;
constexpr double kNegligible = 1e-3, kSumEpsilon = 1e-10, kSumTolerance = 1e-2;
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

}  // namespace

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
    row = (row < kNegligible).select(0.0, row);
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

}  // namespace anigen::eval
