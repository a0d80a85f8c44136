// Skin metrics of Anymate and Puppeteer, and the plain distances under their several averagings.
#include "anigen/metrics/skin_metrics.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

/// Finite differences of a score in every weight: evaluation has no backward pass, but the slopes of its metrics can
/// be compared with the published gradients. Central, or one-sided of second order where the weight would turn
/// negative.
/// @param step_of step for a weight
template <typename Score, typename Step>
torch::Tensor slopes(const metrics::SkinMatrix& predicted, Score score, Step step_of) {
  Eigen::MatrixXd result(predicted.rows(), predicted.cols());
  metrics::SkinMatrix moved = predicted;
  for (Eigen::Index v = 0; v < predicted.rows(); ++v) {
    for (Eigen::Index j = 0; j < predicted.cols(); ++j) {
      const double weight = predicted(v, j), step = step_of(weight);
      const auto at = [&](double value) {
        moved(v, j) = value;
        return score(moved);
      };
      if (weight >= step) {
        result(v, j) = (at(weight + step) - at(weight - step)) / (2.0 * step);
      } else {
        result(v, j) = (4.0 * at(weight + step) - at(weight + 2.0 * step) - 3.0 * at(weight)) / (2.0 * step);
      }
      moved(v, j) = weight;
    }
  }
  return tensor(result);
}

void run_skin(Fixture& fixture) {
  const metrics::SkinMatrix predicted = matrix(fixture.input("pred")), truth = matrix(fixture.input("gt"));
  const double threshold = fixture.config().at("threshold"), filter = fixture.config().at("filter_thre");

  const metrics::AnymateSkinScore anymate = metrics::anymate_skin(predicted, truth, threshold);
  fixture.check("anymate", torch::tensor({anymate.cos_loss, anymate.cross_entropy, anymate.cos_clamp_loss, anymate.mae,
                                          anymate.mean_l1, anymate.overlap.precision, anymate.overlap.recall},
                                         torch::kFloat64));
  const auto cross_entropy = [&](const metrics::SkinMatrix& p) {
    return metrics::anymate_skin(p, truth).cross_entropy;
  };
  const auto cos_clamp = [&](const metrics::SkinMatrix& p) { return metrics::anymate_skin(p, truth).cos_clamp_loss; };
  fixture.check("grad_ce", slopes(predicted, cross_entropy, [](double w) { return 1e-3 * (w + 1e-6); }));
  fixture.check("grad_cos_clamp", slopes(predicted, cos_clamp, [](double) { return 1e-6; }));

  const metrics::SkinMatrix raw = matrix(fixture.input("pred_puppeteer"));
  fixture.check("puppeteer_filtered", tensor(metrics::puppeteer_filtered(raw, filter)));
  const metrics::PuppeteerSkinScore puppeteer = metrics::puppeteer_skin(raw, truth, filter);
  fixture.check("puppeteer",
                torch::tensor({puppeteer.overlap.precision, puppeteer.overlap.recall, puppeteer.l1}, torch::kFloat64));

  const metrics::PlainSkinScore plain = metrics::plain_skin(predicted, truth);
  fixture.check("l1_mean", scalar(plain.l1_mean));
  fixture.check("l2_mean", scalar(plain.l2_mean));
  fixture.check("l1_per_vertex", scalar(plain.l1_per_vertex));
  fixture.check("max_abs", scalar(plain.max_abs));
  fixture.check("kl_batchmean", scalar(plain.kl_batch_mean));
  fixture.check("kl_elementmean", scalar(plain.kl_element_mean));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_metric_skin, anigen::test::run_skin)
