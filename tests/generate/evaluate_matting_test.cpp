#include "anigen/generate/evaluate_matting.h"

#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "anigen/generate/grabcut.h"
#include "tests/data/disc_dataset.h"
#include "tests/generate/red_matting.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

TEST(MattingScores, AreThoseOfKnownMasks) {
  const MattingScore same = matting_score({255, 255, 0, 0}, {1.0F, 1.0F, 0.0F, 0.0F});
  EXPECT_EQ(same.iou, 1.0);
  EXPECT_EQ(same.mae, 0.0);
  const MattingScore half = matting_score({255, 255, 0, 0}, {1.0F, 0.0F, 0.0F, 0.0F});
  EXPECT_EQ(half.iou, 0.5);
  EXPECT_EQ(half.mae, 0.25);
  EXPECT_EQ(matting_score({0, 0}, {1.0F, 0.0F}).iou, 0.0);
  EXPECT_EQ(matting_score({0, 0}, {0.0F, 0.0F}).iou, 1.0);
  EXPECT_THROW(matting_score({0}, {0.0F, 0.0F}), InputError);
  EXPECT_THROW(matting_score({}, {}), InputError);
}

TEST(MattingEvaluations, ScoreANetworkBesideGrabCut) {
  const test::TemporaryFolder folder;
  test::write_disc_dataset(folder / "data", 4);
  test::write_red_matting(folder / "red");
  MattingEvaluationRequest request;
  request.matting.network = folder / "red";
  request.data = (folder / "data").string();
  request.out = folder / "out";
  request.pictured = 2;
  const MattingEvaluation result = evaluate_matting(request);
  std::vector<std::string> methods{"red"};
  if (has_grabcut()) methods.emplace_back("GrabCut");
  EXPECT_EQ(result.methods, methods);
  ASSERT_EQ(result.ids.size(), 4U);
  for (const auto& scores : result.scores) {
    ASSERT_EQ(scores.size(), 4U);
    for (const MattingScore& score : scores) {
      EXPECT_GE(score.iou, 0.0);
      EXPECT_LE(score.iou, 1.0);
      EXPECT_GE(score.mae, 0.0);
      EXPECT_LE(score.mae, 1.0);
    }
  }
  for (const char* file : {"metrics.csv", "metrics.json", "table.md", "samples.png"})
    EXPECT_TRUE(std::filesystem::exists(folder / "out" / file)) << file;
  EXPECT_EQ(result.table().rows.size(), methods.size());

  // A seed composes equal pictures; the one asset of a split is the first of them.
  std::ofstream(folder / "one.txt") << "disc0\n";
  request.splits = {folder / "one.txt"};
  request.out = folder / "one";
  const MattingEvaluation one = evaluate_matting(request);
  EXPECT_EQ(one.ids, std::vector<std::string>{"disc0"});
  EXPECT_EQ(one.scores.back()[0].iou, result.scores.back()[0].iou);

  request.backgrounds = folder / "nowhere";
  EXPECT_THROW(evaluate_matting(request), InputError);
  request.backgrounds.clear();
  request.matting.network = folder / "data";  // a folder that is no run
  EXPECT_THROW(evaluate_matting(request), InputError);
}

}  // namespace
}  // namespace anigen::generate
