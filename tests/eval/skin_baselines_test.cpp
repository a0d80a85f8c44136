#include "anigen/eval/skin_baselines.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/random.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::eval {
namespace {

/// A chain along x: joints at 0, 1 and 2. The tip's own bone goes on to 2.5.
GroundTruth chain() {
  GroundTruth truth;
  truth.joints = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  truth.parents = {-1, 0, 1};
  truth.vertices = {{0.3f, 0.1f, 0}, {1.6f, 0, -0.2f}, {2.2f, 0.1f, 0}, {3, 0, 0}};
  truth.skin = {1, 0, 0, 0.2f, 0.7f, 0.1f, 0, 0.5f, 0.5f, 0, 0, 1};
  return truth;
}

/// Weights of a given rank: random mixes of random rows.
GroundTruth random_truth(std::size_t vertices, std::size_t joints, std::size_t rank) {
  Rng rng(7, "baseline test");
  GroundTruth truth;
  truth.joints.assign(joints, Eigen::Vector3f::Zero());
  truth.vertices.assign(vertices, Eigen::Vector3f::Zero());
  truth.parents.assign(joints, 0);
  truth.parents[0] = -1;
  std::vector<double> basis(rank * joints);
  for (double& b : basis) b = std::pow(rng.uniform(), 4.0);
  truth.skin.resize(vertices * joints);
  for (std::size_t v = 0; v < vertices; ++v) {
    std::vector<double> row(joints, 0.0);
    double sum = 0;
    for (std::size_t k = 0; k < rank; ++k) {
      const double mix = rng.uniform();
      for (std::size_t j = 0; j < joints; ++j) row[j] += mix * basis[k * joints + j];
    }
    for (const double w : row) sum += w;
    for (std::size_t j = 0; j < joints; ++j) truth.skin[v * joints + j] = static_cast<float>(row[j] / sum);
  }
  return truth;
}

double l1(const std::vector<float>& weights, const GroundTruth& truth) {
  return metrics::score_skin(weights, truth.skin, truth.vertex_count(), truth.joint_count()).mean.l1;
}

TEST(SkinBaselines, NearestBoneTakesTheBoneAVertexLiesOn) {
  EXPECT_EQ(nearest_bone_weights(chain()), (std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1}));
}

TEST(SkinBaselines, InverseDistanceIsAPowerLawOfBoneDistances) {
  const GroundTruth truth = chain();
  const std::vector<float> weights = inverse_distance_weights(truth, 2.0);
  // Vertex 3 at x = 3 is 2, 1 and 0.5 away from the three bones: squares of the inverses are 1/4, 1 and 4.
  EXPECT_NEAR(weights[9], 0.25 / 5.25, 1e-5);
  EXPECT_NEAR(weights[10], 1.0 / 5.25, 1e-5);
  EXPECT_NEAR(weights[11], 4.0 / 5.25, 1e-5);
  for (std::size_t v = 0; v < 4; ++v) EXPECT_NEAR(weights[3 * v] + weights[3 * v + 1] + weights[3 * v + 2], 1.0, 1e-6);
}

TEST(SkinBaselines, StrongestJointIsTheBestHardAssignment) {
  const GroundTruth truth = chain();
  EXPECT_EQ(strongest_joint_weights(truth), (std::vector<float>{1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1}));
  EXPECT_LE(l1(strongest_joint_weights(truth), truth), l1(nearest_bone_weights(truth), truth));
}

TEST(SkinBaselines, RankFourIsExactForFourJointsOrFewer) {
  for (std::size_t joints : {1u, 2u, 4u}) {
    const GroundTruth truth = random_truth(50, joints, joints);
    EXPECT_LT(l1(low_rank_weights(truth), truth), 1e-5) << joints << " joints";
    EXPECT_EQ(mixture_weights(truth), truth.skin) << joints << " joints";
  }
}

TEST(SkinBaselines, RankFourIsExactForWeightsOfRankFourAndNotBeyond) {
  const GroundTruth four = random_truth(200, 12, 4), eight = random_truth(200, 12, 8);
  EXPECT_LT(l1(low_rank_weights(four), four), 1e-5);
  EXPECT_GT(l1(low_rank_weights(eight), eight), 1e-3);
  EXPECT_LT(l1(low_rank_weights(eight, 8), eight), 1e-5);
}

TEST(SkinBaselines, MixtureComesCloseToWeightsThatAreMixtures) {
  const GroundTruth truth = random_truth(200, 12, 4);
  const double start = l1(mixture_weights(truth, 4, 0), truth), fitted = l1(mixture_weights(truth, 4, 400), truth);
  EXPECT_LT(fitted, 0.05);
  EXPECT_LT(fitted, 0.2 * start);
}

TEST(SkinBaselines, AllGiveRowsThatSumToOne) {
  const GroundTruth truth = random_truth(40, 9, 6);
  for (const SkinMethod& method : skin_baselines()) {
    const std::vector<float> weights = method.predict({}, truth);
    ASSERT_EQ(weights.size(), truth.skin.size()) << method.key;
    for (std::size_t v = 0; v < 40; ++v) {
      double sum = 0;
      for (std::size_t j = 0; j < 9; ++j) {
        EXPECT_GE(weights[v * 9 + j], 0.0f);
        sum += weights[v * 9 + j];
      }
      EXPECT_NEAR(sum, 1.0, 1e-5) << method.key;
    }
  }
}

}  // namespace
}  // namespace anigen::eval
