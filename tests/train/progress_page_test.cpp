#include "anigen/train/metrics_log.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/support/paths.h"

namespace anigen::train {
namespace {

CsvTable evaluations(const std::vector<std::string>& values) {
  CsvTable table;
  table.columns = {"step", "loss.total", "eval.j2j", "time.elapsed_s"};
  for (std::size_t i = 0; i < values.size(); ++i)
    table.rows.push_back({std::to_string(10 * (i + 1)), "0.5", values[i], std::to_string(1800 * (i + 1))});
  return table;
}

TEST(HasStalled, AsksWhetherTheLastEvaluationsImproveOnTheBestBefore) {
  EXPECT_FALSE(has_stalled(evaluations({"1", "0.5"}), "eval.j2j", 2, 0.02)) << "too few";
  EXPECT_TRUE(has_stalled(evaluations({"1", "0.5", "0.495", "0.6"}), "eval.j2j", 2, 0.02));
  EXPECT_FALSE(has_stalled(evaluations({"1", "0.5", "0.6", "0.48"}), "eval.j2j", 2, 0.02));
  EXPECT_FALSE(has_stalled(evaluations({"1", "", "0.5", ""}), "eval.j2j", 1, 0.02)) << "rows without it do not count";
  EXPECT_FALSE(has_stalled(evaluations({"1", "1", "1"}), "eval.unknown", 1, 0.02));
}

TEST(HasEvaluation, LooksAtTheRowsOfAStep) {
  const CsvTable table = evaluations({"1", "", "0.5"});
  EXPECT_TRUE(has_evaluation(table, 10));
  EXPECT_FALSE(has_evaluation(table, 20)) << "a row of the training alone";
  EXPECT_FALSE(has_evaluation(table, 40));
}

TEST(HasStalled, KnowsMetricsThatGrow) {
  CsvTable table = evaluations({"0.011", "0.329", "0.423", "0.623"});
  table.columns[2] = "eval.iou_skl";
  EXPECT_FALSE(has_stalled(table, "eval.iou_skl", 3, 0.02)) << "better each time";
  table = evaluations({"0.2", "0.6", "0.601", "0.5"});
  table.columns[2] = "eval.recall";
  EXPECT_TRUE(has_stalled(table, "eval.recall", 2, 0.02));
  for (const char* name : {"eval.f1_shape", "eval.cos", "eval.precision", "eval.iou"})
    EXPECT_TRUE(is_larger_better(name)) << name;
  for (const char* name : {"eval.l1", "eval.kl", "eval.cd", "eval.chamfer", "eval.real_l1", "eval.joint_count_error"})
    EXPECT_FALSE(is_larger_better(name)) << name;
}

TEST(ProgressPage, HasCurvesHoursAndTheNewestSamples) {
  const test::TemporaryFolder folder;
  for (const char* step : {"step9", "step10"}) {
    std::filesystem::create_directories(folder / "samples" / step);
    std::ofstream(folder / "samples" / step / "creature.png") << "png";
  }
  const std::string html = progress_page(RunFolder{folder.path()}, evaluations({"0.4", "0.3"}), {"a <run>", 40, 8});
  EXPECT_NE(html.find("a &lt;run&gt;"), std::string::npos);
  EXPECT_NE(html.find("Step 20 of 40, 160 samples, 1.00 h of training, about 1.00 h left."), std::string::npos);
  EXPECT_NE(html.find("eval.j2j by hours"), std::string::npos);
  EXPECT_NE(html.find("samples/step10/creature.png"), std::string::npos);
  EXPECT_EQ(html.find("samples/step9/"), std::string::npos);
}

}  // namespace
}  // namespace anigen::train
