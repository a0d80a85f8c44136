#include "anigen/experiment/results.h"

#include <cmath>

#include "anigen/core/atomic_file.h"
#include "anigen/core/log.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/result_tables.h"
#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

TEST(Statistics, StudentsIntervalOfKnownValues) {
  const eval::Interval three = student_interval({1, 2, 3});  // 2 ± 4.3027 · 1 / √3
  EXPECT_NEAR(three.high - 2, 4.3027 / std::sqrt(3.0), 1e-3);
  EXPECT_NEAR(2 - three.low, 4.3027 / std::sqrt(3.0), 1e-3);
  std::vector<double> many;
  for (int i = 0; i < 31; ++i) many.push_back(i % 2);
  const double mean = 15.0 / 31, deviation = std::sqrt(31 * mean * (1 - mean) / 30);
  EXPECT_NEAR(student_interval(many).high - mean, 2.0423 * deviation / std::sqrt(31.0), 1e-4);  // 30 degrees
  EXPECT_EQ(student_interval({5}).low, 5);
}

TEST(Statistics, SignFlipsKnowAConstantDifferenceFromNone) {
  EXPECT_TRUE(std::isnan(sign_flip_p({1, 1, 1, 1, 1}, "few")));
  // All ten of one sign: 2 of 1,024 choices are as far.
  EXPECT_NEAR(sign_flip_p(std::vector<double>(10, 0.3), "all"), 2.0 / 1024, 1.5e-3);
  EXPECT_NEAR(sign_flip_p({1, -1, 2, -2, 3, -3, 1, -1}, "none"), 1.0, 1e-9);
}

class ExperimentResults : public ExperimentFolder {
 protected:
  ExperimentResults() : experiment_(experiment(kTwoVariants)), plan_(make_plan(experiment_, place_)) {
    log::setup("off");
  }
  void scores(std::size_t run, const std::vector<std::string>& values) {
    std::string text = "id,method,failure,j2j\n";
    for (std::size_t i = 0; i < values.size(); ++i)
      text += "asset" + std::to_string(i) + ",ours," + (values[i].empty() ? "broken" : "") + "," + values[i] + "\n";
    write_file_atomically(job_of(plan_, run, "score").folder / "metrics.csv", text);
  }
  ResultTable table() { return collect_results(experiment_, plan_, place_.out, experiment_.tables[0]); }

  Experiment experiment_;
  Plan plan_;
};

TEST_F(ExperimentResults, MeansOverSeedsDifferencesOverAssets) {
  run_jobs(place_.out, plan_, {});
  scores(0, {"1", "2", "3", "4", "5", "6"});
  scores(1, {"3", "4", "5", "6", "7", "8"});
  scores(2, {"1", "2", "3", "4", "5", "6"});
  scores(3, {"2", "3", "4", "5", "6", ""});
  const ResultTable result = table();
  ASSERT_EQ(result.rows.size(), 2u);
  const Row &plain = result.rows[0], &fast = result.rows[1];
  EXPECT_EQ(plain.cells[0].by_seed, (std::vector<double>{3.5, 5.5}));
  EXPECT_DOUBLE_EQ(plain.cells[0].mean, 4.5);
  EXPECT_NEAR(plain.cells[0].interval.high - 4.5, 12.7062, 1e-3);  // √2 / √2 · t of one degree
  EXPECT_DOUBLE_EQ(plain.cells[0].by_asset.at("asset0"), 2);
  EXPECT_EQ(fast.assets, 12u);
  EXPECT_EQ(fast.failed, 1u);
  EXPECT_EQ(fast.cells[0].by_seed, (std::vector<double>{3.5, 4}));
  ASSERT_EQ(result.differences.size(), 1u);
  EXPECT_EQ(result.differences[0].columns[0].n, 6u);
  EXPECT_NEAR(result.differences[0].columns[0].mean, (5 * -0.5 - 1) / 6, 1e-12);  // the last asset: 6 against 7
  EXPECT_NE(to_markdown(mean_table(result)).find("**3.7500"), std::string::npos);
  EXPECT_NE(to_latex(mean_table(result)).find("\\textbf{3.7500 $\\pm$"), std::string::npos);
}

// What both seeds share is one run: its interval is over the assets, and not without width.
TEST_F(ExperimentResults, ARowThatNoSeedChangesHasItsAssetsInterval) {
  run_jobs(place_.out, plan_, {});
  for (const std::size_t run : {0, 1, 2, 3}) scores(run, {"1", "2", "3", "4", "5", "6"});
  const Cell cell = table().rows[0].cells[0];
  EXPECT_EQ(cell.by_seed, std::vector<double>{3.5});
  EXPECT_LT(cell.interval.low, 3.0);
  EXPECT_GT(cell.interval.high, 4.0);
}

TEST_F(ExperimentResults, WhatIsMissingIsNamed) {
  run_jobs(place_.out, plan_, {1, 0, "data"});
  EXPECT_EQ(table().missing.size(), 4u);
  EXPECT_TRUE(table().rows.empty());
}

TEST_F(ExperimentResults, AFileWithoutTheColumnIsAnError) {
  run_jobs(place_.out, plan_, {});
  write_file_atomically(job_of(plan_, 0, "score").folder / "metrics.csv", "id,method\n1,ours\n");
  EXPECT_NE(error_of([&] { table(); }).find("has no column 'j2j'"), std::string::npos);
}

TEST_F(ExperimentResults, TheReportIsOneFileAndNamesItsSources) {
  run_jobs(place_.out, plan_, {});
  const std::string html = read_file(write_report(experiment_, plan_, place_));
  for (const char* part : {"Two variants", "<svg", "fast, seed 1", "SHA-256", "anigen-train", "Scores"})
    EXPECT_NE(html.find(part), std::string::npos) << part;
  EXPECT_EQ(html.find("src=\"http"), std::string::npos);
  for (const char* file : {"report.md", "1.tex", "results.json"}) EXPECT_FALSE(read_file(place_.out / file).empty());
}

TEST_F(ExperimentResults, ValuesThatDifferByRoundingReadEqual) {
  run_jobs(place_.out, plan_, {});
  for (const std::size_t run : {0, 1}) scores(run, {"0.1", "0.2", "0.3", "0.4", "0.5", "0.6"});
  for (const std::size_t run : {2, 3})
    scores(run, {"0.10000000000000002", "0.20000000000000004", "0.30000000000000004", "0.40000000000000008",
                 "0.50000000000000011", "0.60000000000000009"});
  const ResultTable result = table();
  EXPECT_EQ(difference_table(result).rows.at(0).back(), "equal");
  EXPECT_DOUBLE_EQ(result.differences[0].p[0], 1.0);
  const eval::Table means = mean_table(result);
  for (const auto& row : means.rows) EXPECT_EQ(row.back().rfind("**", 0), 0u) << row.back();
}

}  // namespace
}  // namespace anigen::experiment
