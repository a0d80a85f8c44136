#include "anigen/eval/comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <new>
#include <stdexcept>
#include <thread>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/table.h"
#include "anigen/core/version.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/io/rigs/rigged_shape.h"
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

// A saved result of another build is that build's: it counts only when the request accepts it, and then under its name.
TEST_F(RunComparisonTest, ResultsOfAnotherCommitAreComputedAgainUnlessAccepted) {
  run_evaluation(request());
  const auto relabel = [&](const Json& commit) {
    for (const fs::path& file : saved()) {
      Json json = read_json(file);
      EXPECT_EQ(json["commit"], Json(anigen::commit())) << file;
      json["commit"] = commit;
      json["values"]["j2j"] = 7.5;
      write_file_atomically(file, json.dump());
    }
  };
  for (const Json& other : {Json("0123456789"), Json()}) {
    relabel(other);
    if (other.is_null()) {  // as programs wrote them that recorded no commit
      for (const fs::path& file : saved()) {
        Json json = read_json(file);
        json.erase("commit");
        write_file_atomically(file, json.dump());
      }
    }
    EvaluationRequest accepting = request();
    accepting.accept_other_code = true;
    const Comparison accepted = run_evaluation(accepting);
    EXPECT_EQ(accepted.results[0][0].value("j2j"), 7.5);
    EXPECT_EQ(accepted.settings["made_by"], anigen::made_by());
    EXPECT_EQ(accepted.settings["results_of_other_commits"],
              (Json{{other.is_null() ? "none recorded" : "0123456789", 3}}));

    testing::internal::CaptureStderr();
    log::setup("warn");
    const Comparison again = run_evaluation(request());
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_NEAR(again.results[0][0].value("j2j"), 0.0, 1e-6);
    EXPECT_FALSE(again.settings.contains("results_of_other_commits"));
    const std::size_t first = said.find("3 saved results of pairs were made by ");
    ASSERT_NE(first, std::string::npos) << said;
    EXPECT_NE(said.find(other.is_null() ? "recorded no commit" : "0123456789", first), std::string::npos) << said;
    EXPECT_EQ(said.find("3 saved results", first + 1), std::string::npos) << "said once: " << said;
  }
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

// Memory, LibTorch, OpenCV: one pair's failure, and the others are evaluated.
TEST_F(RunComparisonTest, WhateverOnePairThrowsIsItsFailure) {
  EvaluationRequest with_lpips = request();
  with_lpips.settings.groups = {"image"};
  with_lpips.settings.lpips = "of a test";
  with_lpips.report = false;
  set_thread_count(1);
  std::size_t calls = 0;
  with_lpips.perceptual.lpips = [&calls](const io::Image&, const io::Image&) -> double {
    if (++calls == 1) throw std::bad_alloc();
    if (calls == 2) throw std::runtime_error("shapes differ\nException raised from f at x.cpp:1");
    return 0.5;
  };
  const Comparison comparison = run_evaluation(with_lpips);
  set_thread_count(0);
  EXPECT_EQ(comparison.results[0][0].failure, "out of memory");
  EXPECT_EQ(comparison.results[1][0].failure, "shapes differ");
  EXPECT_EQ(comparison.results[0][1].failure, "");
  EXPECT_NEAR(comparison.results[0][1].value("lpips"), 0.5, 1e-9);
  EXPECT_EQ(read_csv(folder_ / "out/metrics.csv").rows.size(), 4u);
  with_lpips.resume = false;
  with_lpips.perceptual.lpips = [](const io::Image&, const io::Image&) -> double { throw Interrupted("stopped"); };
  EXPECT_THROW(run_evaluation(with_lpips), Interrupted);
}

TEST_F(RunComparisonTest, AResultThatWouldReplaceAnInputIsRefused) {
  fs::create_directories(folder_ / "out");
  write_file_atomically(folder_ / "out/metrics.csv", "pred,gt\n../good/a.glb,../truth/a.glb\n");
  const std::string before = read_file(folder_ / "out/metrics.csv");
  EvaluationRequest csv = request();
  csv.predictions = {(folder_ / "out/metrics.csv").string()};
  csv.truth.clear();
  EXPECT_THROW(run_evaluation(csv), InputError);
  EXPECT_EQ(read_file(folder_ / "out/metrics.csv"), before);
  EvaluationRequest split = request();
  split.splits = {folder_ / "out/table.md"};
  write_file_atomically(folder_ / "out/table.md", "a\n");
  EXPECT_THROW(run_evaluation(split), InputError);
  EvaluationRequest moving = request();
  moving.motions_pictured = 1;
  test::write_glb(folder_ / "out/motion/a/truth.glb", {});
  moving.truth = folder_ / "out/motion/a";
  EXPECT_THROW(run_evaluation(moving), InputError);
  EXPECT_FALSE(fs::exists(folder_ / "out/pairs")) << "before any work";
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

TEST_F(RunComparisonTest, SaysWhereOneIdMeansTwoTruths) {
  write_file_atomically(folder_ / "one.csv", "pred,gt,id\ngood/a.glb,truth/a.glb,x\npoor/a.glb,truth/b.glb,y\n");
  std::filesystem::copy_file(folder_ / "truth/a.glb", folder_ / "truth/copy_of_a.glb");
  std::filesystem::copy_file(folder_ / "poor/a.glb", folder_ / "truth/another.glb");
  const auto told = [&](const std::string& rows) {
    write_file_atomically(folder_ / "two.csv", "pred,gt,id\n" + rows);
    EvaluationRequest csvs = request();
    csvs.predictions = {"one=" + (folder_ / "one.csv").string(), "two=" + (folder_ / "two.csv").string()};
    csvs.truth.clear();
    std::filesystem::remove_all(csvs.out);
    log::setup("warn");
    testing::internal::CaptureStderr();
    run_evaluation(csvs);
    std::string text = testing::internal::GetCapturedStderr();
    log::setup("off");
    return text;
  };
  EXPECT_EQ(told("good/a.glb,truth/copy_of_a.glb,x\ngood/a.glb,truth/b.glb,y\n").find("another ground truth"),
            std::string::npos);
  const std::string swapped = told("good/a.glb,truth/another.glb,x\ngood/a.glb,truth/b.glb,y\n");
  EXPECT_NE(swapped.find("1 rows of two have another ground truth than in one under the same id, such as x: "),
            std::string::npos)
      << swapped;
}

// One command for three programs on one split of an Articulation-XL shard: predictions called by the sha256 that our
// dataset gives the samples, and by their uuids as others write them.
TEST_F(RunComparisonTest, ThreeProgramsOnOneSplitOfAShard) {
  std::vector<test::RigFile> rigs(3);
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    rigs[i].uuid = "uuid-" + std::to_string(i);
    rigs[i].joints[4] += 0.1 * static_cast<double>(i);
  }
  test::write_articulation_xl(folder_ / "xl.npz", rigs);
  const auto shard = io::open_source(folder_ / "xl.npz", {io::Axes::kFormat, true});
  for (const test::RigFile& rig : rigs) {
    test::write_glb(folder_ / "ours" / (shard->sample_id(rig.uuid) + ".glb"), rig);
    test::write_glb(folder_ / "unirig" / (rig.uuid + ".glb"), rig);
  }
  test::write_rig_npz(folder_ / "puppeteer" / "uuid-2" / "raw_data.npz", rigs[2]);
  test::write_rig_npz(folder_ / "puppeteer" / "stray" / "raw_data.npz", rigs[0]);
  write_file_atomically(folder_ / "uuids.txt", "uuid-1\nuuid-2\n");
  EvaluationRequest one = request();
  one.predictions.clear();
  for (const char* name : {"ours", "unirig", "puppeteer"})
    one.predictions.push_back(std::string(name) + "=" + (folder_ / name).string());
  one.truth = folder_ / "xl.npz";
  one.splits = {folder_ / "uuids.txt"};
  one.settings.groups = {"skeleton"};
  const Comparison comparison = run_evaluation(one);
  EXPECT_EQ(comparison.ids, (std::vector<std::string>{"uuid-1", "uuid-2"}));
  for (std::size_t m = 0; m < 3; ++m) EXPECT_NEAR(comparison.results[m][1].value("j2j"), 0.0, 1e-6) << m;
  EXPECT_EQ(comparison.pairing[0].paired, 2u);
  EXPECT_EQ(comparison.pairing[0].unused.size(), 1u) << "uuid-0 is not of the split";
  EXPECT_EQ(comparison.pairing[2].missing, std::vector<std::string>{"uuid-1"});
  EXPECT_EQ(comparison.pairing[2].unused, std::vector<std::string>{"stray"});
  EXPECT_NE(read_file(folder_ / "out" / "table.md").find("1: stray"), std::string::npos);
  EXPECT_EQ(read_json(folder_ / "out" / "metrics.json")["pairing"]["puppeteer"]["missing"][0], "uuid-1");
  // Of two files of one name none is chosen.
  fs::create_directories(folder_ / "unirig" / "first");
  fs::rename(folder_ / "unirig" / "uuid-1.glb", folder_ / "unirig" / "first" / "uuid-1.glb");
  test::write_glb(folder_ / "unirig" / "again" / "uuid-1.glb", rigs[1]);
  EXPECT_THROW(run_evaluation(one), InputError);
}

TEST_F(RunComparisonTest, TransportBySinkhornWhenAskedFor) {
  EvaluationRequest asked = request();
  asked.settings.groups = {"transport"};
  const PairResult exact = run_evaluation(asked).results[1][0];
  asked.settings.transport = parse_transport("sinkhorn");
  const PairResult close = run_evaluation(asked).results[1][0];
  asked.settings.epsilon = 0.5;
  const PairResult coarse = run_evaluation(asked).results[1][0];
  for (const char* key : {"wasserstein", "gromov_wasserstein"}) {
    EXPECT_GE(close.value(key), exact.value(key) - 1e-9) << key;
    EXPECT_GT(coarse.value(key), exact.value(key) + 1e-3) << key << ": a saved exact result does not count";
    EXPECT_GT(coarse.value(key), close.value(key) + 1e-3) << key << ": nor one of another epsilon";
  }
  EXPECT_NEAR(close.value("wasserstein"), exact.value("wasserstein"), 0.01);
  for (const char* key : {"gw_lower_bound", "fused_gromov_wasserstein"}) EXPECT_EQ(coarse.value(key), exact.value(key));
  EXPECT_EQ(coarse.details["gw_start"], "entropic");
  EXPECT_EQ(read_json(folder_ / "out/metrics.json")["settings"]["transport"],
            (Json{{"solver", "sinkhorn"}, {"epsilon_wasserstein", 0.5}, {"epsilon_gromov_wasserstein", 0.5}}));
  for (const char* file : {"table.md", "table.tex", "report.html"})
    EXPECT_NE(read_file(folder_ / "out" / file).find("Sinkhorn iterations; epsilon 0.5 and 0.5"), std::string::npos)
        << file;

  EvaluationRequest refused = request();
  refused.settings.epsilon = 0.01;
  EXPECT_THROW(run_evaluation(refused), InputError) << "without sinkhorn";
  refused.settings.transport = TransportMethod::kSinkhorn;
  for (const double epsilon : {0.0, -1.0, 1.5, std::nan("")}) {
    refused.settings.epsilon = epsilon;
    EXPECT_THROW(run_evaluation(refused), InputError) << epsilon;
  }
  refused.settings.epsilon.reset();
  refused.settings.groups = {"skeleton"};
  EXPECT_THROW(run_evaluation(refused), InputError) << "nothing of it would be computed";
  EXPECT_THROW(parse_transport("simplex"), InputError);
}

}  // namespace
}  // namespace anigen::eval
