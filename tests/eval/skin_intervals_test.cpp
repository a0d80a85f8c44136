#include "anigen/eval/skin_intervals.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace anigen::eval {
namespace {

/// Two methods on rigs of these skeletons; the first one's scores are as given, the second's twice as large.
SkinEvaluation evaluation_of(const std::vector<std::pair<std::string, double>>& rigs) {
  SkinEvaluation evaluation;
  evaluation.poses = 1;
  evaluation.methods.resize(2);
  evaluation.methods[0].label = "ours";
  evaluation.methods[1].label = "theirs";
  for (const auto& [skeleton, score] : rigs) {
    AssetResult asset;
    asset.skeleton = skeleton;
    for (const double factor : {1.0, 2.0}) {
      MethodResult result;
      result.scores.mean.l1 = factor * score;
      result.scores.mean.kl = 10.0 * factor * score;
      result.deformation = 0.1 * factor * score;
      asset.methods.push_back(result);
    }
    evaluation.assets.push_back(asset);
  }
  return evaluation;
}

TEST(SkeletonMeans, CountEverySkeletonOnce) {
  // Three rigs of one skeleton, one of another: (0.3 + 0.9) / 2, not the mean of the four.
  const SkinEvaluation evaluation = evaluation_of({{"a", 0.2}, {"b", 0.9}, {"a", 0.3}, {"a", 0.4}});
  const SkeletonMeans ours = over_skeletons(evaluation, 0), theirs = over_skeletons(evaluation, 1);
  EXPECT_EQ(ours.skeletons, 2U);
  EXPECT_EQ(ours.assets, 4U);
  EXPECT_NEAR(ours.mean[0], 0.6, 1e-12);
  EXPECT_NEAR(ours.mean[1], 6.0, 1e-12);
  EXPECT_NEAR(ours.mean[2], 0.06, 1e-12);
  EXPECT_GE(ours.interval[0].low, 0.3 - 1e-12);
  EXPECT_LE(ours.interval[0].high, 0.9 + 1e-12);
  EXPECT_LT(ours.interval[0].low, ours.interval[0].high);
  EXPECT_NEAR(theirs.to_first[0].mean, 0.6, 1e-12);
  EXPECT_EQ(theirs.to_first[0].n, 2U);
  EXPECT_EQ(to_json(ours)["skin_l1"]["mean"], ours.mean[0]);
}

TEST(SkeletonMeans, DifferencesAreOfTheSameRigs) {
  // Two rigs of one skeleton, of which the first method fails on the hard one.
  SkinEvaluation evaluation = evaluation_of({{"a", 0.2}, {"a", 0.9}});
  evaluation.assets[1].methods[0].failure = "no";
  const SkeletonMeans theirs = over_skeletons(evaluation, 1);
  EXPECT_NEAR(theirs.mean[0], 1.1, 1e-12);
  EXPECT_NEAR(theirs.to_first[0].mean, 0.2, 1e-12) << "0.4 − 0.2, not 1.1 − 0.2";
}

TEST(SkeletonMeans, LeaveOutWhatHasNoScores) {
  SkinEvaluation evaluation = evaluation_of({{"a", 0.2}, {"b", 0.9}});
  evaluation.assets[1].methods[0].failure = "no";
  const SkeletonMeans ours = over_skeletons(evaluation, 0), theirs = over_skeletons(evaluation, 1);
  EXPECT_EQ(ours.skeletons, 1U);
  EXPECT_NEAR(ours.mean[0], 0.2, 1e-12);
  EXPECT_EQ(theirs.skeletons, 2U);
  EXPECT_EQ(theirs.to_first[0].n, 1U);
  evaluation.assets[0].methods[0].failure = "no";
  EXPECT_EQ(over_skeletons(evaluation, 0).skeletons, 0U);
  const anigen::Table table = skeleton_table(evaluation);
  ASSERT_EQ(table.rows.size(), 2U);
  EXPECT_EQ(table.rows[0][0], "ours");
  EXPECT_EQ(table.rows[0][1], "–");
  EXPECT_NE(table.rows[1][1], "–");
}

}  // namespace
}  // namespace anigen::eval
