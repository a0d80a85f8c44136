#include "anigen/experiment/claims.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/experiment/command.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

eval::PairedDifference advantage(double low, double high, std::size_t n = 20) {
  eval::PairedDifference difference;
  difference.mean = 0.5 * (low + high);
  difference.interval = {low, high};
  difference.n = n;
  return difference;
}

TEST(Verdicts, NeedBothIntervalsOnOneSideOfTheMargin) {
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3), 0.01, {0.05, 0.4}, 3, 0.0), Verdict::kConfirmed);
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3), 0.01, {-0.05, 0.4}, 3, 0.0), Verdict::kTooSmall);
  EXPECT_EQ(verdict_of(advantage(-0.1, 0.3), 0.01, {0.05, 0.4}, 3, 0.0), Verdict::kTooSmall);
  EXPECT_EQ(verdict_of(advantage(-0.3, -0.1), 0.01, {-0.4, -0.05}, 3, 0.0), Verdict::kRefuted);
  EXPECT_EQ(verdict_of(advantage(-0.3, -0.1), 0.01, {-0.4, 0.05}, 3, 0.0), Verdict::kTooSmall);
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3), 0.01, {-0.2, -0.2}, 1, 0.0), Verdict::kConfirmed)
      << "one seed has no interval";
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3, 5), 0.01, {0.1, 0.3}, 3, 0.0), Verdict::kTooSmall) << "five assets";
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3, 6), 0.06, {0.1, 0.3}, 3, 0.0), Verdict::kTooSmall) << "six assets";
  EXPECT_EQ(verdict_of(advantage(-0.3, -0.1), 0.05, {-0.3, -0.1}, 3, 0.0), Verdict::kTooSmall);
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3), 0.01, {0.1, 0.3}, 3, 0.2), Verdict::kTooSmall);
  EXPECT_EQ(verdict_of(advantage(0.1, 0.3), 0.01, {0.1, 0.3}, 3, 0.4), Verdict::kRefuted);
  EXPECT_EQ(verdict_of(advantage(-0.01, 0.01), 0.01, {-0.02, 0.02}, 3, -0.05), Verdict::kConfirmed) << "not much worse";
}

class ExperimentClaims : public ExperimentFolder {
 protected:
  ExperimentClaims() { log::setup("off"); }

  /// kTwoVariants with these claims.
  static std::string with_claims(const std::string& claims, const std::string& more = "") {
    std::string text = kTwoVariants;
    return text.substr(0, text.rfind('}')) + ", \"claims\": [" + claims + "]" + more + "}";
  }
  static std::string claim(const std::string& sides, const std::string& better = "lower") {
    return R"({"claim": "fast is better", "source": "Table 9", "step": "score", "published": [0.25, 0.5],
               "column": {"key": "j2j", "label": "J2J", "better": ")" +
           better + R"("}, )" + sides + "}";
  }
  static constexpr const char kFastOverPlain[] = R"("of": {"variant": "fast"}, "over": {"variant": "plain"})";

  void scores(const Plan& plan, std::size_t run, double first, const std::string& method = "ours") {
    std::string text = "id,method,failure,j2j\n";
    for (int i = 0; i < 8; ++i)
      text += std::to_string(i) + "," + method + ",," + std::to_string(first + 0.01 * i) + "\n";
    write_file_atomically(job_of(plan, run, "score").folder / "metrics.csv", text);
  }
};

TEST_F(ExperimentClaims, AreJudgedByAssetsAndSeeds) {
  const Experiment read = experiment(with_claims(claim(kFastOverPlain) + "," + claim(kFastOverPlain, "higher")));
  const Plan made = make_plan(read, place_);
  EXPECT_EQ(judge_claims(read, made, place_.out)[0].verdict, Verdict::kNotRun);
  run_jobs(place_.out, made, {});
  scores(made, 0, 1.0);
  scores(made, 1, 1.02);
  scores(made, 2, 0.8);
  scores(made, 3, 0.82);
  std::vector<ClaimResult> results = judge_claims(read, made, place_.out);
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(results[0].verdict, Verdict::kConfirmed);
  EXPECT_NEAR(results[0].by_asset.mean, 0.2, 1e-9);
  EXPECT_EQ(results[0].by_asset.n, 8U);
  ASSERT_EQ(results[0].by_seed.size(), 2U);
  EXPECT_NEAR(results[0].by_seed[1], 0.2, 1e-9);
  EXPECT_EQ(results[1].verdict, Verdict::kRefuted);
  EXPECT_NEAR(results[1].by_asset.mean, -0.2, 1e-9);
  // Seeds compare the assets that both sides have: the failure of the worst one is no advantage.
  std::string text = "id,method,failure,j2j\n7,ours,broken,\n";
  for (int i = 0; i < 7; ++i) text += std::to_string(i) + ",ours,," + std::to_string(0.8 + 0.01 * i) + "\n";
  write_file_atomically(job_of(made, 2, "score").folder / "metrics.csv", text);
  const ClaimResult without = judge_claims(read, made, place_.out)[0];
  EXPECT_NEAR(without.by_seed[0], 0.2, 1e-9);
  EXPECT_EQ(without.assets, 8U);
  EXPECT_NEAR(without.here.second - without.here.first, 0.2, 1e-9) << "of the same assets";
  // Seeds that disagree say nothing, however well the assets agree.
  scores(made, 2, 0.5);
  results = judge_claims(read, made, place_.out);
  EXPECT_EQ(results[0].verdict, Verdict::kTooSmall);
  const Experiment one = experiment(with_claims(claim(kFastOverPlain), ", \"seeds\": [0]"));
  EXPECT_EQ(judge_claims(one, make_plan(one, place_), place_.out)[0].reason, "one seed");
  const std::string report = read_file(write_report(read, made, place_).replace_extension(".md"));
  for (const char* part : {"## Claims", "Table 9", "0.2500 / 0.5000", "too small to tell", "J2J of fast / plain"})
    EXPECT_NE(report.find(part), std::string::npos) << part;
  EXPECT_EQ(load_config(place_.out / "results.json")["claims"][1]["verdict"], "too small to tell");
}

TEST_F(ExperimentClaims, MayCompareMethodsAndSteps) {
  const Experiment read = experiment(with_claims(claim(
      R"("of": {"variant": "fast", "method": "ours"}, "over": {"step": "fit", "file": "scores.csv", "key": "distance"})")));
  const Plan made = make_plan(read, place_);
  run_jobs(place_.out, made, {});
  std::string text = "id,method,failure,distance\n";
  for (int i = 0; i < 8; ++i) text += std::to_string(i) + ",fit,,9\n";
  for (const std::size_t run : {0U, 1U}) write_file_atomically(job_of(made, run, "fit").folder / "scores.csv", text);
  const ClaimResult result = judge_claims(read, made, place_.out)[0];
  EXPECT_EQ(result.reason, "");
  EXPECT_EQ(result.over.mean, 9.0);
  EXPECT_GT(result.by_asset.mean, 8.0);
}

TEST_F(ExperimentClaims, WithoutAMethodAreAboutTheModel) {
  const Experiment read = experiment(with_claims(claim(kFastOverPlain)));
  const Plan made = make_plan(read, place_);
  run_jobs(place_.out, made, {});
  // A baseline is written first, and is the worst by far.
  const auto two_methods = [&](std::size_t run, double first, const std::string& name) {
    std::string text = "id,method,failure,j2j\n";
    for (int i = 0; i < 8; ++i) {
      const std::string id = std::to_string(i);
      text += id + ",baseline,,7\n" + id + "," + name + ",," + std::to_string(first + 0.01 * i) + "\n";
    }
    write_file_atomically(job_of(made, run, "score").folder / "metrics.csv", text);
  };
  for (const std::size_t run : {0U, 1U}) two_methods(run, 1.0, "model");
  for (const std::size_t run : {2U, 3U}) scores(made, run, 0.8);
  ClaimResult result = judge_claims(read, made, place_.out)[0];
  EXPECT_EQ(result.verdict, Verdict::kConfirmed);
  EXPECT_NEAR(result.by_asset.mean, 0.2, 1e-9);
  EXPECT_LT(result.p, 0.05);
  for (const std::size_t run : {0U, 1U}) two_methods(run, 1.0, "ours");
  result = judge_claims(read, made, place_.out)[0];
  EXPECT_EQ(result.verdict, Verdict::kNotRun);
  EXPECT_NE(result.reason.find("baseline, ours"), std::string::npos) << result.reason;
}

TEST_F(ExperimentClaims, ThatCannotBeUnderstoodAreRefused) {
  const auto refusal = [&](const std::string& text) { return error_of([&] { experiment(with_claims(text)); }); };
  EXPECT_NE(refusal(claim(R"("of": {"variant": "fats"})")).find("no variant"), std::string::npos);
  EXPECT_NE(refusal(claim(R"("of": {"variant": "plain"})")).find("the same"), std::string::npos);
  EXPECT_NE(refusal(claim(kFastOverPlain, "none")).find("better"), std::string::npos);
  EXPECT_NE(refusal(claim(R"("of": {"step": "scroe"})")).find("scroe"), std::string::npos);
}

TEST_F(ExperimentClaims, AScaleChangesTheWholeFile) {
  const std::string scales = R"(, "scales": {
      "tiny": {"seeds": [7], "steps": {"data": {"args": {"--procedural": 1}}, "elsewhere": {"minutes": 3}}},
      "other": "scale.json"})";
  write("scale.json", R"({"title": "Smaller"})");
  write("experiment.json", with_claims(claim(kFastOverPlain), scales));
  const auto file = folder_ / "experiment.json";
  EXPECT_EQ(read_experiment(file).seeds.size(), 2U);
  const Experiment tiny = read_experiment(file, {}, "tiny");
  EXPECT_EQ(tiny.seeds, std::vector<std::uint64_t>{7});
  EXPECT_EQ(tiny.steps["data"]["args"]["--procedural"], 1);
  EXPECT_FALSE(tiny.steps.contains("elsewhere"));
  EXPECT_EQ(read_experiment(file, {}, "other").title, "Smaller");
  EXPECT_NE(error_of([&] { read_experiment(file, {}, "huge"); }).find("tiny"), std::string::npos);
  write("plain.json", kTwoVariants);
  EXPECT_NE(error_of([&] { read_experiment(folder_ / "plain.json", {}, "tiny"); }).find("no scales"),
            std::string::npos);
}

TEST_F(ExperimentClaims, PathsMayBeginInAnotherFolder) {
  std::filesystem::create_directories(folder_ / "deep");
  write("deep/experiment.json", with_claims(claim(kFastOverPlain), R"(, "paths_from": "..")"));
  const Experiment read = read_experiment(folder_ / "deep/experiment.json");
  EXPECT_NO_THROW(make_plan(read, place_));
  write("deep/experiment.json", kTwoVariants);
  EXPECT_THROW(make_plan(read_experiment(folder_ / "deep/experiment.json"), place_), InputError);
}

TEST_F(ExperimentClaims, ACollectionSharesJobsAndCountsVerdicts) {
  write("one.json", with_claims(claim(kFastOverPlain)));
  write("two.json", with_claims(claim(kFastOverPlain) + "," + claim(kFastOverPlain, "higher")));
  write("all.json", R"({"title": "All of it", "purpose": "Both.", "experiments": ["one.json", "two.json"]})");
  ExperimentCommand command;
  command.file = folder_ / "all.json";
  command.place = place_;
  const std::string text = run_experiment_command(command, false);
  EXPECT_EQ(calls("anigen-train"), 4U) << "two variants of two seeds, once";
  for (const char* file : {"one/report.html", "two/report.md", "verdicts.md", "verdicts.html", "verdicts.json"})
    EXPECT_TRUE(std::filesystem::exists(place_.out / file)) << file;
  EXPECT_NE(text.find("All of it"), std::string::npos);
  EXPECT_NE(text.find("3 "), std::string::npos) << text;
  command.what = ExperimentCommand::What::kClean;
  EXPECT_THROW(run_experiment_command(command, false), NotSupportedError);
  write("all.json", R"({"title": "All of it", "experiments": ["one.json", "missing.json"]})");
  command.what = ExperimentCommand::What::kRun;
  EXPECT_NE(error_of([&] { run_experiment_command(command, false); }).find("1 of 2 experiments"), std::string::npos);
}

}  // namespace
}  // namespace anigen::experiment
