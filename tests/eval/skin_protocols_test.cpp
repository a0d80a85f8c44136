#include "anigen/eval/skin/skin_protocols.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

SkinMatrix rows(std::initializer_list<std::initializer_list<double>> values) {
  SkinMatrix result(static_cast<Eigen::Index>(values.size()), static_cast<Eigen::Index>(values.begin()->size()));
  Eigen::Index v = 0;
  for (const auto& row : values) {
    Eigen::Index j = 0;
    for (const double value : row) result(v, j++) = value;
    ++v;
  }
  return result;
}

TEST(SkinProtocols, AnymateAgreesWithHandComputedNumbers) {
  const SkinMatrix truth = rows({{1, 0}, {0.5, 0.5}}), predicted = rows({{0.8, 0.2}, {0.98, 0.02}});
  const AnymateSkinScore score = anymate_skin(predicted, truth);
  const double cos0 = 0.8 / std::hypot(0.8, 0.2), cos1 = 0.5 / (std::hypot(0.98, 0.02) * std::sqrt(0.5));
  EXPECT_NEAR(score.cos_loss, 1 - 0.5 * (cos0 + cos1), 1e-12);
  EXPECT_NEAR(score.cross_entropy, -0.5 * (std::log(0.8) + 0.5 * std::log(0.98) + 0.5 * std::log(0.02)), 1e-4);
  EXPECT_NEAR(score.mean_l1, 0.5 * (0.4 + 0.96), 1e-12);
  EXPECT_NEAR(score.mae, 0.5 * score.mean_l1, 1e-15);
  // Sets at 0.05: {0, 1} against {0}, and {0} against {0, 1}.
  EXPECT_DOUBLE_EQ(score.overlap.precision, 0.75);
  EXPECT_DOUBLE_EQ(score.overlap.recall, 0.75);
}

TEST(SkinProtocols, AnymateCountsEmptyRowsInTheDenominatorOnly) {
  const SkinMatrix truth = rows({{1, 0}, {0, 0}}), predicted = rows({{1, 0}, {1, 0}});
  const AnymateSkinScore score = anymate_skin(predicted, truth);
  EXPECT_DOUBLE_EQ(score.overlap.precision, 0.5);
  EXPECT_DOUBLE_EQ(score.overlap.recall, 0.5);
  EXPECT_DOUBLE_EQ(score.cos_loss, 0.5);  // the cosine with an empty row is 0
  // The threshold itself counts.
  EXPECT_DOUBLE_EQ(anymate_skin(rows({{0.25, 0.75}}), rows({{1, 0}}), 0.25).overlap.recall, 1.0);
}

TEST(SkinProtocols, AnymateClampHidesWeightsBelowAThousandth) {
  const SkinMatrix truth = rows({{1, 0}});
  EXPECT_NEAR(anymate_skin(rows({{0.9995, 0.0005}}), truth).cos_clamp_loss, 0.0, 1e-15);
  EXPECT_GT(anymate_skin(rows({{0.9995, 0.0005}}), truth).cos_loss, 1e-8);
}

TEST(SkinProtocols, PuppeteerDropsWhatIsSmallBesideTheLargest) {
  const SkinMatrix filtered =
      puppeteer_filtered(rows({{0.8, 0.11, 0.09}, {0.0005, 0.0004, 0.0001}, {0.5, 0.25, 0.25}}));
  EXPECT_NEAR(filtered(0, 0), 1.0, 1e-9);  // 0.15 of 0.8 is 0.12: both others go
  EXPECT_EQ(filtered(0, 1), 0.0);
  EXPECT_EQ(filtered.row(1).sum(), 0.0);  // nothing reaches 1e-3
  EXPECT_NEAR(filtered(2, 1), 0.25, 1e-9);
}

TEST(SkinProtocols, PuppeteerCountsOverAllPairsAndKeepsWholeRows) {
  const SkinMatrix truth = rows({{1, 0, 0}, {0.5, 0.5, 0}, {0.5, 0.4, 0}});
  const SkinMatrix predicted = rows({{0.6, 0.4, 0}, {0.5, 0.25, 0.25}, {0, 0, 1}});
  const PuppeteerSkinScore score = puppeteer_skin(predicted, truth);
  EXPECT_EQ(score.kept, 2u);  // the last true row sums to 0.9
  EXPECT_NEAR(score.overlap.precision, 3.0 / 5, 1e-9);
  EXPECT_NEAR(score.overlap.recall, 3.0 / 3, 1e-9);
  EXPECT_NEAR(score.l1, 0.5 * (0.8 + 0.5), 1e-9);
  EXPECT_EQ(puppeteer_skin(predicted, rows({{0, 0, 0}, {0, 0, 0}, {0, 0, 0}})).kept, 0u);
}

TEST(SkinProtocols, RignetAveragesOverVertices) {
  const SkinMatrix truth = rows({{1, 0}, {0.5, 0.5}}), predicted = rows({{0.9999, 0.0001}, {1, 0}});
  const SkinOverlap overlap = rignet_skin_overlap(predicted, truth);
  EXPECT_DOUBLE_EQ(overlap.precision, 1.0);  // 1e-4 does not exceed 1e-4
  EXPECT_DOUBLE_EQ(overlap.recall, 0.75);
}

TEST(SkinProtocols, PlainDistancesAgreeWithHandComputedNumbers) {
  const SkinMatrix truth = rows({{1, 0}, {1, 1}}), predicted = rows({{0.75, 0.25}, {0.5, 0.5}});
  const PlainSkinScore score = plain_skin(predicted, truth);
  EXPECT_DOUBLE_EQ(score.l1_mean, (0.25 + 0.25 + 0.5 + 0.5) / 4);
  EXPECT_DOUBLE_EQ(score.l2_mean, (0.0625 + 0.0625 + 0.25 + 0.25) / 4);
  EXPECT_DOUBLE_EQ(score.l1_per_vertex, (0.5 + 1.0) / 2);
  EXPECT_DOUBLE_EQ(score.max_abs, 0.5);
  // The second true row counts as (½, ½) here, which is what was predicted.
  EXPECT_NEAR(score.kl_batch_mean, std::log(1 / 0.75) / 2, 1e-12);
  EXPECT_NEAR(score.kl_element_mean, (std::log(1 / 0.75) + 2 * std::log(1 / 0.5)) / 4, 1e-9);
}

TEST(SkinProtocols, AreZeroForIdenticalWeights) {
  const SkinMatrix weights = rows({{1, 0, 0}, {0.25, 0.5, 0.25}, {0, 0.5, 0.5}});
  const PlainSkinScore plain = plain_skin(weights, weights);
  EXPECT_EQ(plain.l1_mean, 0.0);
  EXPECT_NEAR(plain.kl_batch_mean, 0.0, 1e-15);
  const AnymateSkinScore anymate = anymate_skin(weights, weights);
  EXPECT_NEAR(anymate.cos_loss, 0.0, 1e-15);
  EXPECT_EQ(anymate.overlap.precision, 1.0);
  const PuppeteerSkinScore puppeteer = puppeteer_skin(weights, weights);
  EXPECT_NEAR(puppeteer.l1, 0.0, 1e-9);
  EXPECT_NEAR(puppeteer.overlap.recall, 1.0, 1e-9);
  const SkinOverlap rignet = rignet_skin_overlap(weights, weights);
  EXPECT_EQ(rignet.precision, 1.0);
  EXPECT_EQ(rignet.recall, 1.0);
}

TEST(SkinProtocols, RejectBadInput) {
  const SkinMatrix good = rows({{1, 0}});
  EXPECT_THROW(plain_skin(good, rows({{1, 0, 0}})), InputError);
  EXPECT_THROW(anymate_skin(good, rows({{1, 0}, {1, 0}})), InputError);
  EXPECT_THROW(puppeteer_skin(rows({{std::nan(""), 1}}), good), InputError);
  EXPECT_THROW(rignet_skin_overlap(good, rows({{-0.1, 1.1}})), InputError);
  EXPECT_THROW(plain_skin(SkinMatrix(0, 2), SkinMatrix(0, 2)), InputError);
  EXPECT_THROW(skin_matrix(std::vector<double>{1, 2, 3}, 2, 2), InputError);
  EXPECT_THROW(skin_matrix(std::vector<float>{1, 2, 3}, 2, 2), InputError);
}

TEST(SkinProtocols, TakeFlatArrays) {
  const std::vector<double> predicted = {0.75, 0.25, 0, 1};
  const std::vector<float> truth = {1, 0, 0, 1};
  EXPECT_DOUBLE_EQ(plain_skin(skin_matrix(predicted, 2, 2), skin_matrix(truth, 2, 2)).l1_per_vertex, 0.25);
}

}  // namespace
}  // namespace anigen::eval
