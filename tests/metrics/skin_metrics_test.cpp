#include <gtest/gtest.h>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::metrics {

namespace {

TEST(SkinMetrics, AgreeWithHandComputedNumbers) {
  // Row 0 is exact; row 1 has differences (-0.25, 0.25, 0); row 2 misses its only joint completely.
  const std::vector<float> truth = {1, 0, 0, 0.5f, 0.25f, 0.25f, 0, 0, 1};
  const std::vector<float> predicted = {1, 0, 0, 0.25f, 0.5f, 0.25f, 0, 1, 0};
  const SkinScores scores = score_skin(predicted, truth, 3, 3);
  const double row1_kl = 0.5 * std::log(2.0) + 0.25 * std::log(0.5);
  const double row2_kl = std::log((1 + 1e-8) / 1e-8);
  EXPECT_NEAR(scores.mean.l1, (0 + 0.5 + 2) / 3, 1e-7);
  EXPECT_NEAR(scores.mean.l2, (0 + std::sqrt(0.125) + std::sqrt(2.0)) / 3, 1e-7);
  EXPECT_NEAR(scores.mean.kl, (0 + row1_kl + row2_kl) / 3, 1e-6);
}

TEST(SkinMetrics, SeparateVerticesByTrueInfluences) {
  // Six joints; rows with 1, 2 and 6 true influences.
  std::vector<float> truth(18, 0.0f), predicted(18, 0.0f);
  truth[0] = 1;
  truth[6] = truth[7] = 0.5f;
  for (int j = 0; j < 6; ++j) truth[12 + j] = 1.0f / 6;
  predicted[1] = predicted[6] = predicted[12] = 1;
  const SkinScores scores = score_skin(predicted, truth, 3, 6);
  EXPECT_EQ(scores.class_sizes, (std::array<std::size_t, 5>{1, 1, 0, 0, 1}));
  EXPECT_NEAR(scores.by_influences[0].l1, 2.0, 1e-6);
  EXPECT_NEAR(scores.by_influences[1].l1, 1.0, 1e-6);
  EXPECT_NEAR(scores.by_influences[4].l1, 10.0 / 6, 1e-6);
  EXPECT_EQ(scores.by_influences[2].l1, 0.0);
  EXPECT_NEAR(scores.mean.l1, (2.0 + 1.0 + 10.0 / 6) / 3, 1e-6);
}

TEST(SkinMetrics, DivergenceUsesTheGroundTruthFirst) {
  // KL(truth || prediction) of (1, 0) and (0.5, 0.5) is log 2; the other way round it would be huge.
  EXPECT_NEAR(score_skin({0.5f, 0.5f}, {1, 0}, 1, 2).mean.kl, std::log(2.0), 1e-7);
  EXPECT_GT(score_skin({1, 0}, {0.5f, 0.5f}, 1, 2).mean.kl, 8.0);
}

TEST(SkinMetrics, VertexL1IsWhatTheMeanIsMadeOf) {
  const std::vector<float> truth = {1, 0, 0.5f, 0.5f}, predicted = {0.75f, 0.25f, 0.5f, 0.5f};
  EXPECT_EQ(vertex_l1(predicted, truth, 2, 2), (std::vector<float>{0.5f, 0.0f}));
  EXPECT_NEAR(score_skin(predicted, truth, 2, 2).mean.l1, 0.25, 1e-7);
}

TEST(NormalizeRows, DividesCountsAndRefuses) {
  std::vector<float> rows = {2, 2, 0.5f, 0.5f};
  EXPECT_EQ(normalize_rows(rows, 2, 2, "f"), 1u);
  EXPECT_EQ(rows, (std::vector<float>{0.5f, 0.5f, 0.5f, 0.5f}));
  for (const float bad : {-0.1f, std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    std::vector<float> broken = {1, 0, 1, bad};
    try {
      normalize_rows(broken, 2, 2, "some.npz");
      ADD_FAILURE() << "accepted " << bad;
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), "some.npz");
      EXPECT_EQ(error.place(), "skin[1, 1]");
    }
  }
  std::vector<float> empty = {1, 0, 0, 0};
  EXPECT_THROW(normalize_rows(empty, 2, 2, "f"), InputError);
}

}  // namespace

namespace {

SkinWeights random_skin(std::size_t vertices, std::size_t joints, std::uint64_t seed) {
  Rng rng(seed, "skin_matching_test");
  SkinWeights skin;
  for (std::size_t v = 0; v < vertices; ++v) {
    std::vector<Influence> row;
    for (int i = 0; i < 3; ++i)
      row.push_back({static_cast<std::int32_t>(rng.index(joints)), static_cast<float>(rng.uniform(0.1, 1.0))});
    skin.append_row(row);
  }
  return skin;
}

TEST(SkinMatching, OfIdenticalSkeletonsLeavesTheWeights) {
  const SkinWeights skin = random_skin(50, 6, 1);
  const std::vector<double> matched = matched_weights(skin, Eigen::MatrixXd::Identity(6, 6) / 6.0);
  const std::vector<float> dense = to_dense(skin, 6);
  ASSERT_EQ(matched.size(), dense.size());
  for (std::size_t i = 0; i < dense.size(); ++i) EXPECT_NEAR(matched[i], dense[i], 1e-6);
  const SkinScores scores = score_skin(single_precision(matched), dense, 50, 6);
  EXPECT_LT(scores.mean.l1, 1e-6);
}

TEST(SkinMatching, SplitsWeightsAsThePlanSplitsMass) {
  // Predicted joint 0 goes to true joint 0; joint 1 three quarters to 1 and a quarter to 2.
  Eigen::MatrixXd plan(2, 3);
  plan << 0.5, 0, 0,  //
      0, 0.375, 0.125;
  SkinWeights skin;
  skin.append_row({{0, 0.5f}, {1, 0.5f}});
  skin.append_row({{1, 1.0f}});
  EXPECT_EQ(matched_weights(skin, plan), (std::vector<double>{0.5, 0.375, 0.125, 0, 0.75, 0.25}));
}

TEST(SkinMatching, IsTheDenseProductOfTheDefinition) {
  Rng rng(2, "skin_matching_plan");
  Eigen::MatrixXd plan(5, 4);
  for (double& p : plan.reshaped()) p = rng.uniform();
  const SkinWeights skin = random_skin(30, 5, 3);
  const std::vector<float> dense = to_dense(skin, 5);
  const std::vector<double> matched = matched_weights(skin, plan);
  for (std::size_t v = 0; v < 30; ++v) {
    double sum = 0;
    for (int k = 0; k < 4; ++k) {
      double expected = 0;
      for (int j = 0; j < 5; ++j)
        expected += dense[v * 5 + static_cast<std::size_t>(j)] * plan(j, k) / plan.row(j).sum();
      EXPECT_NEAR(matched[v * 4 + static_cast<std::size_t>(k)], expected, 1e-6);
      sum += matched[v * 4 + static_cast<std::size_t>(k)];
    }
    EXPECT_NEAR(sum, 1.0, 1e-15);
  }
}

TEST(SkinMatching, DoesNotDependOnTheNumberingOfPredictedJoints) {
  Rng rng(4, "skin_matching_plan");
  Eigen::MatrixXd plan(5, 4), shuffled(5, 4);
  for (double& p : plan.reshaped()) p = rng.uniform();
  const std::vector<std::size_t> name = rng.permutation(5);
  for (int j = 0; j < 5; ++j) shuffled.row(static_cast<Eigen::Index>(name[static_cast<std::size_t>(j)])) = plan.row(j);
  const SkinWeights skin = random_skin(30, 5, 5);
  SkinWeights renamed = skin;
  for (Influence& influence : renamed.influences)
    influence.joint = static_cast<std::int32_t>(name[static_cast<std::size_t>(influence.joint)]);
  const std::vector<double> a = matched_weights(skin, plan), b = matched_weights(renamed, shuffled);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-15);
}

TEST(SkinMatching, AnEmptyRowCountsAsTheFirstJoint) {
  SkinWeights skin;
  skin.append_row({});
  EXPECT_EQ(matched_weights(skin, Eigen::MatrixXd::Identity(2, 2)), (std::vector<double>{1, 0}));
}

TEST(SkinMatching, TheStrongestMatchIsTheLargestEntryAndTheFirstOfEquals) {
  Eigen::MatrixXd plan(3, 3);
  plan << 0.1, 0.2, 0.0,  //
      0.2, 0.0, 0.2,      //
      0.0, 0.0, 0.3;
  EXPECT_EQ(strongest_match(plan), (std::vector<int>{1, 0, 2}));
}

TEST(SkinMatching, RejectsBadInput) {
  SkinWeights skin;
  skin.append_row({{1, 1.0f}});
  EXPECT_THROW(matched_weights(skin, Eigen::MatrixXd::Identity(1, 1)), InputError);  // joint 1 of 1
  EXPECT_THROW(matched_weights(skin, Eigen::MatrixXd(0, 0)), InputError);
  EXPECT_THROW(matched_weights(skin, Eigen::MatrixXd::Zero(2, 2)), InputError);
  EXPECT_THROW(matched_weights(skin, Eigen::MatrixXd::Constant(2, 2, -1)), InputError);
  EXPECT_THROW(matched_weights(skin, Eigen::MatrixXd::Constant(2, 2, std::nan(""))), InputError);
}

}  // namespace

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

}  // namespace anigen::metrics
