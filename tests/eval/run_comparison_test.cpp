#include "anigen/eval/comparison/run_comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/eval/comparison/evaluate_command.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

class RunComparisonTest : public ::testing::Test {
 protected:
  RunComparisonTest() {
    for (const char* name : {"a", "b"}) test::write_glb(folder_ / "truth" / (std::string(name) + ".glb"), {});
    test::write_glb(folder_ / "good" / "a.glb", {});
    test::write_glb(folder_ / "good" / "b.glb", {});
    test::write_glb(folder_ / "poor" / "a.glb", moved());
    test::write_glb(folder_ / "poor" / "stray.glb", {});
  }

  static test::RigFile moved() {
    test::RigFile rig;
    rig.joints[3] += 0.1;
    return rig;
  }

  EvaluationRequest request() {
    EvaluationRequest request;
    request.predictions = {"good=" + (folder_ / "good").string(), "poor=" + (folder_ / "poor").string()};
    request.truth = folder_ / "truth";
    request.out = folder_ / "out";
    request.settings.alignment.registration.rotations = 5;
    request.settings.surface_samples = 500;
    request.settings.image_size = 32;
    request.pictured = 1;
    return request;
  }

  std::vector<fs::path> saved() {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / "out" / "pairs")) {
      if (entry.is_regular_file()) files.push_back(entry.path());
    }
    return files;
  }

  test::TemporaryFolder folder_;
};

TEST_F(RunComparisonTest, ComparesMethodsAndKeepsMissingPredictionsAsRows) {
  const Comparison comparison = run_evaluation(request());
  ASSERT_EQ(comparison.methods, (std::vector<std::string>{"good", "poor"}));
  EXPECT_NEAR(comparison.results[0][0].value("j2j"), 0.0, 1e-6);
  EXPECT_GT(comparison.results[1][0].value("j2j"), 1e-3);
  EXPECT_FALSE(comparison.results[1][1].failure.empty());
  EXPECT_EQ(comparison.unused, std::vector<std::string>{"poor: stray"});
  for (const char* name : {"metrics.json", "metrics.csv", "table.md", "table.tex", "report.html"})
    EXPECT_TRUE(fs::exists(folder_ / "out" / name)) << name;
  const std::string report = read_file(folder_ / "out" / "report.html");
  EXPECT_NE(report.find("class=\"turn\""), std::string::npos);
  EXPECT_NE(report.find("the same random poses"), std::string::npos);
  EXPECT_EQ(report.find("No picture"), std::string::npos);
}

TEST_F(RunComparisonTest, FinishedPairsAreNotComputedAgainUnlessTheirInputChanged) {
  const Comparison first = run_evaluation(request());
  ASSERT_EQ(saved().size(), 3u);
  std::map<fs::path, fs::file_time_type> times;
  for (const fs::path& file : saved()) times[file] = fs::last_write_time(file);
  const Comparison second = run_evaluation(request());
  for (const fs::path& file : saved()) EXPECT_EQ(fs::last_write_time(file), times[file]) << file;
  EXPECT_EQ(second.results[1][0].values, first.results[1][0].values);

  test::RigFile other = moved();
  other.joints[4] += 0.2;
  test::write_glb(folder_ / "poor" / "a.glb", other);
  const Comparison third = run_evaluation(request());
  EXPECT_NE(third.results[1][0].value("j2j"), first.results[1][0].value("j2j"));
  EXPECT_EQ(third.results[0][0].values, first.results[0][0].values);
}

TEST_F(RunComparisonTest, CallsAtTheSameTimeShareThePairs) {
  const Comparison alone = run_evaluation(request());
  fs::remove_all(folder_ / "out");
  std::vector<Comparison> comparisons(3);
  std::vector<std::thread> threads;
  for (Comparison& comparison : comparisons) threads.emplace_back([&] { comparison = run_evaluation(request()); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(saved().size(), 3u) << "results alone, no leases";
  for (const Comparison& comparison : comparisons) {
    for (std::size_t m = 0; m < 2; ++m) {
      for (std::size_t i = 0; i < 2; ++i) {
        const auto &ours = comparison.results[m][i].values, &wanted = alone.results[m][i].values;
        ASSERT_EQ(ours.size(), wanted.size());
        for (const auto& [name, value] : wanted) {
          if (name == "seconds" || std::isnan(value)) continue;  // NaN: not computed
          EXPECT_EQ(ours.at(name), value) << name;
        }
        EXPECT_EQ(comparison.results[m][i].failure, alone.results[m][i].failure);
      }
    }
  }
}

TEST_F(RunComparisonTest, ADamagedSavedResultIsComputedAgain) {
  const Comparison first = run_evaluation(request());
  for (const fs::path& file : saved()) write_file_atomically(file, "{\"stamp\": ");
  const Comparison second = run_evaluation(request());
  EXPECT_EQ(second.results[1][0].value("j2j"), first.results[1][0].value("j2j"));
}

TEST_F(RunComparisonTest, DamagedFilesFailTheirRowOnly) {
  write_file_atomically(folder_ / "good" / "b.glb", "glTF");
  const Comparison comparison = run_evaluation(request());
  EXPECT_TRUE(comparison.results[0][0].failure.empty());
  EXPECT_NE(comparison.results[0][1].failure.find("b.glb"), std::string::npos);
}

TEST_F(RunComparisonTest, RefusesARequestThatCannotBeMeant) {
  EvaluationRequest twice = request();
  twice.predictions[1] = twice.predictions[0];
  EXPECT_THROW(run_evaluation(twice), InputError);
  EvaluationRequest nothing = request();
  nothing.truth.clear();
  EXPECT_THROW(run_evaluation(nothing), InputError);
  EvaluationRequest unknown = request();
  unknown.worst_by = "beauty";
  EXPECT_THROW(run_evaluation(unknown), InputError);
}

TEST_F(RunComparisonTest, TakesACsvOfPairs) {
  write_file_atomically(folder_ / "pairs.csv", "pred,gt\ngood/a.glb,truth/a.glb\npoor/a.glb,truth/b.glb\n");
  EvaluationRequest csv = request();
  csv.predictions = {(folder_ / "pairs.csv").string()};
  csv.truth.clear();
  const Comparison comparison = run_evaluation(csv);
  EXPECT_EQ(comparison.ids, (std::vector<std::string>{"a", "b"}));
  EXPECT_GT(comparison.results[0][1].value("j2j"), 1e-3);
}

}  // namespace
}  // namespace anigen::eval
