#include "anigen/eval/skin_metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::eval {
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
}  // namespace anigen::eval
