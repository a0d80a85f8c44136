#include "anigen/eval/skin/skin_matching.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/eval/skin_metrics.h"

namespace anigen::eval {
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
}  // namespace anigen::eval
