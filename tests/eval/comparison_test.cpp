#include <gtest/gtest.h>
#include <atomic>
#include <cmath>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/comparison_report.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/eval/method_differences.h"
#include "anigen/eval/skeleton_groups.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

// The place where a learned distance enters the evaluation; the network itself is tested in tests/models and
// tests/pipeline.

namespace anigen::eval {

namespace {

PairResult result(const std::string& id, double j2j, double fscore) {
  PairResult pair;
  pair.id = id;
  pair.set("j2j", j2j);
  pair.set("fscore", fscore);
  pair.skip("lpips", "no network");
  return pair;
}

Comparison two_methods() {
  Comparison comparison;
  comparison.methods = {"ours", "other_1"};
  comparison.ids = {"a", "b", "c"};
  comparison.results = {{result("a", 0.1, 0.9), result("b", 0.2, 0.8), result("c", 0.3, 0.7)},
                        {result("a", 0.2, 0.8), result("b", 0.4, 0.9), result("c", 0.6, 0.1)}};
  comparison.settings = {{"seed", 0}};
  return comparison;
}

const MetricInfo& metric(const char* key) { return *find_metric(key); }

TEST(Comparison, SummarisesAndRanks) {
  const Comparison comparison = two_methods();
  const MetricSummary summary = summarize_metric(comparison, 0, "j2j");
  EXPECT_DOUBLE_EQ(summary.summary.mean, 0.2);
  EXPECT_EQ(summary.summary.n, 3u);
  EXPECT_GE(summary.summary.mean, summary.interval.low);
  EXPECT_LE(summary.summary.mean, summary.interval.high);
  EXPECT_EQ(ranks(comparison, metric("j2j")), (std::vector<int>{1, 2}));
  EXPECT_EQ(ranks(comparison, metric("fscore")), (std::vector<int>{1, 2}));
  EXPECT_EQ(ranks(comparison, metric("psnr")), (std::vector<int>{0, 0}));
}

TEST(Comparison, EverySkeletonCountsOnce) {
  Comparison comparison = two_methods();
  EXPECT_FALSE(by_skeleton(comparison).has_value()) << "trees are not known";
  for (const std::size_t i : {0U, 1U, 2U}) comparison.results[0][i].details["skeleton"] = i < 2 ? "tree" : "other";
  comparison.results[1][2] = {};
  comparison.results[1][2].failure = "no prediction";
  const auto skeletons = by_skeleton(comparison);
  ASSERT_TRUE(skeletons.has_value());
  EXPECT_EQ(skeletons->ids, (std::vector<std::string>{"other", "tree"}));
  EXPECT_NEAR(skeletons->results[0][1].value("j2j"), 0.15, 1e-12);
  EXPECT_NEAR(summarize_metric(*skeletons, 0, "j2j").summary.mean, 0.5 * (0.15 + 0.3), 1e-12);
  EXPECT_EQ(failures(*skeletons, 1), 1U);
  const Table table = skeleton_mean_table(*skeletons, comparison);
  EXPECT_EQ(table.rows[0][1], "2");
  EXPECT_EQ(table.rows[1][1], "1");
  EXPECT_EQ(table.rows[0][2], "3") << "assets";
  EXPECT_EQ(table.rows[1][2], "2");
  EXPECT_NE(to_markdown(comparison).find("Every skeleton once"), std::string::npos);
  EXPECT_NEAR(to_json(comparison)["over_skeletons"]["methods"]["ours"]["j2j"]["mean"].get<double>(), 0.225, 1e-12);
  for (const std::size_t i : {0U, 1U, 2U}) comparison.results[0][i].details["skeleton"] = std::to_string(i);
  EXPECT_FALSE(by_skeleton(comparison).has_value()) << "each has its own";
}

TEST(Comparison, DoesNotRankMeansOverDifferentAssets) {
  Comparison comparison = two_methods();
  comparison.results[1][2] = {};
  comparison.results[1][2].id = "c";
  comparison.results[1][2].failure = "no prediction";
  EXPECT_EQ(ranks(comparison, metric("j2j")), (std::vector<int>{0, 0}));
  EXPECT_EQ(failures(comparison, 1), 1u);
  const std::string text = to_markdown(comparison);
  EXPECT_NE(text.find("no prediction"), std::string::npos);
  // The asset is a row everywhere.
  EXPECT_EQ(to_csv_table(comparison).rows.size(), 6u);
  EXPECT_EQ(to_json(comparison)["methods"]["other_1"]["assets"].size(), 3u);
  EXPECT_EQ(to_json(comparison)["methods"]["other_1"]["assets"][2]["failure"], "no prediction");
}

TEST(Comparison, FilesHaveTheDocumentedKeys) {
  const Json json = to_json(two_methods());
  for (const char* key : {"j2j",
                          "j2b",
                          "b2b",
                          "wasserstein",
                          "gromov_wasserstein",
                          "fused_gromov_wasserstein",
                          "gw_lower_bound",
                          "skin_l1",
                          "skin_l2",
                          "skin_kl",
                          "deformation_error",
                          "motion_distance",
                          "motion_distance_rest",
                          "surface_chamfer",
                          "fscore",
                          "normal_consistency",
                          "psnr",
                          "ssim",
                          "lpips",
                          "anymate_cd",
                          "anymate_emd",
                          "connectivity_precision",
                          "connectivity_recall",
                          "skin_ce",
                          "skin_cos",
                          "skin_mae",
                          "icp_rmse",
                          "seconds"}) {
    ASSERT_TRUE(json["summary"].contains(key)) << key;
    for (const char* part : {"mean", "median", "std", "n"}) EXPECT_TRUE(json["summary"][key].contains(part)) << key;
    EXPECT_TRUE(json["assets"][0].contains(key)) << key;
  }
  EXPECT_EQ(json["assets"][0]["id"], "a");
  EXPECT_EQ(json["summary"]["j2j"]["n"], 3);
  EXPECT_TRUE(json["summary"]["lpips"]["mean"].is_null());
  EXPECT_EQ(json["assets"][0]["not_computed"]["lpips"], "no network");
  EXPECT_NEAR(json["differences"]["other_1"]["j2j"]["mean"].get<double>(), 0.2, 1e-12);
}

TEST(Comparison, TablesMarkBestAndSecond) {
  const Comparison comparison = two_methods();
  const std::string markdown = to_markdown(comparison);
  EXPECT_NE(markdown.find("**0.2000**"), std::string::npos);
  EXPECT_NE(markdown.find("_0.4000_"), std::string::npos);
  const std::string latex = to_latex(comparison);
  EXPECT_NE(latex.find("\\textbf{0.2000}"), std::string::npos);
  EXPECT_NE(latex.find("\\underline{0.4000}"), std::string::npos);
  EXPECT_NE(latex.find("other\\_1"), std::string::npos);
  EXPECT_NE(latex.find("J2J $\\downarrow$"), std::string::npos);
}

TEST(Comparison, JudgesDifferencesOnlyWithEnoughAssets) {
  Comparison comparison = two_methods();
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "too few assets to tell");
  for (int i = 0; i < 6; ++i) {
    comparison.ids.push_back("more");
    comparison.results[0].push_back(result("more", 0.1 + 0.01 * i, 0.5));
    comparison.results[1].push_back(result("more", 0.3, 0.5 + 0.01 * (i % 2 ? i : -i)));
  }
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "worse");
}

// Many assets of one skeleton are one sample: 12 of a tree on which the second method is worse, 8 others on which it is
// better.
TEST(Comparison, JudgesDifferencesOverSkeletons) {
  Comparison comparison = two_methods();
  comparison.results.assign(2, {});
  comparison.ids.clear();
  for (int i = 0; i < 20; ++i) {
    comparison.ids.push_back(std::to_string(i));
    comparison.results[0].push_back(result(comparison.ids.back(), 0.2, 0.5));
    comparison.results[1].push_back(result(comparison.ids.back(), i < 12 ? 0.4 : 0.15, 0.5));
  }
  EXPECT_EQ(difference_table(comparison).columns[4], "assets");
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "worse");
  for (int i = 0; i < 20; ++i) comparison.results[0][at(i)].details["skeleton"] = i < 12 ? "common" : std::to_string(i);
  const PairedDifference difference = difference_to_first(comparison, 1, "j2j");
  EXPECT_EQ(difference.n, 9U);
  EXPECT_NEAR(difference.mean, (0.2 - 8 * 0.05) / 9.0, 1e-12);
  EXPECT_EQ(difference_table(comparison).columns[4], "skeletons");
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "no clear difference");
  EXPECT_EQ(to_json(comparison)["differences"]["other_1"]["j2j"]["n"], 9);
}

TEST(Comparison, WhatWasMeasuredInDifferentWaysIsNotRanked) {
  Comparison comparison = two_methods();
  const auto registered = [&](std::size_t method, const char* by) {
    for (PairResult& one : comparison.results[method]) one.details["alignment"]["by"] = by;
  };
  registered(0, "surface");
  registered(1, "surface");
  EXPECT_EQ(ranks(comparison, metric("j2j")), (std::vector<int>{1, 2}));
  registered(1, "joints");
  EXPECT_EQ(ranks(comparison, metric("j2j")), (std::vector<int>{0, 0}));
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "measured in different ways");
  EXPECT_EQ(to_json(comparison)["differences"]["other_1"]["j2j"]["measured_alike"], false);
}

TEST(Comparison, NoValueIsNoZeroAndLatexTellsOfFailures) {
  Comparison comparison = two_methods();
  comparison.results[1][2] = {};
  comparison.results[1][2].failure = "no prediction";
  for (PairResult& one : comparison.results[1]) one.values.erase("fscore");
  for (const auto& row : metric_summary_table(comparison, 1).rows) {
    if (row[1] != "fscore") continue;
    EXPECT_EQ(row, (std::vector<std::string>{row[0], "fscore", row[2], "–", "–", "–", "–", "0"}));
  }
  EXPECT_NE(to_latex(comparison).find("(n 2)"), std::string::npos);
  EXPECT_EQ(method_table(comparison, {&metric("j2j")}).rows[1][3].find("(n"), std::string::npos);
}

TEST(Comparison, ValuesThatDifferByRoundingReadEqualInEveryTable) {
  Comparison comparison = two_methods();
  comparison.results.clear();
  comparison.ids.clear();
  comparison.results.resize(2);
  for (int i = 0; i < 8; ++i) {
    comparison.ids.push_back(std::to_string(i));
    comparison.results[0].push_back(result(comparison.ids.back(), 0.1 + 0.01 * i, 0.5));
    comparison.results[1].push_back(result(comparison.ids.back(), 0.1 + 0.01 * i + 1e-16, 0.5 - 1e-9));
  }
  EXPECT_EQ(ranks(comparison, metric("j2j")), (std::vector<int>{1, 1}));
  for (const auto& row : difference_table(comparison).rows) {
    EXPECT_EQ(row.back(), "equal") << row[1];
    EXPECT_EQ(row[2], "0.0000");
  }
  for (const std::string& text : {to_markdown(comparison), comparison_report(comparison, {})}) {
    EXPECT_NE(text.find("equal"), std::string::npos);
    for (const char* word : {"worse", "better", "-0.0000"}) EXPECT_EQ(text.find(word), std::string::npos) << word;
  }
  const std::string latex = to_latex(comparison);
  EXPECT_EQ(latex.find("underline"), std::string::npos) << "both are the best";
  EXPECT_EQ(to_json(comparison)["differences"]["other_1"]["j2j"]["mean"], 0.0);
  // A difference that files can hold stays one.
  for (PairResult& one : comparison.results[1]) one.set("j2j", one.value("j2j") + 1e-5);
  EXPECT_EQ(difference_table(comparison).rows[0].back(), "worse");
}

TEST(Comparison, CountsPairsAndNamesWhatIsLeftOver) {
  Comparison comparison = two_methods();
  comparison.pairing = {{3, {}, {}}, {1, {"b", "c"}, {"1", "2", "3", "4", "5", "6", "7"}}};
  for (const std::string& text : {to_markdown(comparison), comparison_report(comparison, {})}) {
    EXPECT_NE(text.find("2: b, c"), std::string::npos);
    EXPECT_NE(text.find("7: 1, 2, 3, 4, 5, …"), std::string::npos);
  }
  EXPECT_EQ(to_json(comparison)["pairing"]["other_1"]["unused"].size(), 7u);
}

TEST(Comparison, ReportEscapesNamesAndSurvivesPicturesThatFail) {
  Comparison comparison = two_methods();
  comparison.ids[0] = comparison.results[0][0].id = comparison.results[1][0].id = "<script>alert(1)</script>";
  ComparisonReportOptions options;
  options.shapes = [](std::size_t, std::size_t) -> ComparedShapes { throw InputError("x.glb", "", "gone"); };
  const std::string html = comparison_report(comparison, options);
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_NE(html.find("No picture: x.glb"), std::string::npos);
  EXPECT_NE(html.find("<b>0.2000</b>"), std::string::npos);
  options.worst_by = "no_such_metric";
  EXPECT_THROW(comparison_report(comparison, options), InputError);
}

TEST(Statistics, BootstrapIsDeterministicAndCoversTheMean) {
  std::vector<double> values;
  for (int i = 0; i < 50; ++i) values.push_back(i % 7);
  const Interval first = bootstrap_mean(values, 3, "x"), again = bootstrap_mean(values, 3, "x");
  EXPECT_EQ(first.low, again.low);
  EXPECT_EQ(first.high, again.high);
  // Normal theory: mean ± 1.96 σ/√n with σ² = 4 for seven equally likely numbers.
  EXPECT_NEAR(first.high - first.low, 2 * 1.96 * 2.0 / std::sqrt(50.0), 0.2);
  EXPECT_EQ(bootstrap_mean({2.0}, 0, "x").low, 2.0);
  EXPECT_EQ(paired_difference({1, NAN, 3}, {0, 5, 1}, 0, "x").n, 2u);
  EXPECT_DOUBLE_EQ(paired_difference({1, NAN, 3}, {0, 5, 1}, 0, "x").mean, 1.5);
}

TEST(Statistics, EqualIsWhatSinglePrecisionCannotTellApart) {
  EXPECT_TRUE(numerically_equal(0.0, 1e-17));
  EXPECT_TRUE(numerically_equal(30.0, 30.0 + 1e-6)) << "decibels: relative";
  EXPECT_FALSE(numerically_equal(0.0, 1e-6));
  EXPECT_FALSE(numerically_equal(30.0, 30.0001));
  EXPECT_FALSE(numerically_equal(0.0, NAN));
  EXPECT_EQ(places({0.2, 0.1, 0.1 + 1e-12, NAN, 0.3}, true), (std::vector<int>{0, 1, 1, 0, 0}));
  EXPECT_EQ(places({0.2, 0.1, 0.2 - 1e-3}, false), (std::vector<int>{1, 0, 2}));
}

TEST(NamedPath, TakesNamesAndPathsWithEqualsSigns) {
  EXPECT_EQ(named_path("ours=/data/a").first, "ours");
  EXPECT_EQ(named_path("ours=/data/a").second, "/data/a");
  EXPECT_EQ(named_path("/data/x=1/a.glb").first, "a");
  EXPECT_EQ(named_path("/data/x=1/a.glb").second, "/data/x=1/a.glb");
  EXPECT_EQ(named_path("generated").first, "generated");
}

}  // namespace

namespace {

Json weights(const std::string& hash) {
  Json description;
  description["weights_sha256"] = Json::array({hash});
  return description;
}

class LpipsHookTest : public ::testing::Test {
 protected:
  LpipsHookTest() {
    test::write_glb(folder_ / "truth.glb", {});
    test::write_glb(folder_ / "same.glb", {});
  }

  EvaluationRequest request(const Json& description) {
    EvaluationRequest request;
    request.predictions = {(folder_ / "same.glb").string()};
    request.truth = folder_ / "truth.glb";
    request.out = folder_ / "out";
    request.settings.groups = {"image"};
    request.settings.alignment.registration.rotations = 0;
    request.settings.image_size = 32;
    request.report = false;
    request.settings.lpips = description;
    if (!description.is_null()) {
      request.perceptual.lpips = [this](const io::Image& a, const io::Image& b) {
        ++calls_;
        EXPECT_EQ(a.width, 32);
        EXPECT_EQ(b.height, 32);
        return 0.25;
      };
    }
    return request;
  }

  Json metrics() { return read_json(folder_ / "out" / "metrics.json"); }

  test::TemporaryFolder folder_;
  std::atomic<int> calls_{0};
};

TEST_F(LpipsHookTest, WithoutWeightsIsReportedAsNotComputed) {
  const Comparison comparison = run_evaluation(request(nullptr));
  ASSERT_EQ(comparison.results[0][0].failure, "");
  EXPECT_TRUE(std::isfinite(comparison.results[0][0].value("psnr")));
  EXPECT_EQ(comparison.results[0][0].not_computed.at("lpips"), "no weights given");
  EXPECT_EQ(metrics()["assets"][0]["not_computed"]["lpips"], "no weights given");
  EXPECT_TRUE(metrics()["summary"]["lpips"]["mean"].is_null());
  EXPECT_TRUE(metrics()["settings"]["lpips"].is_null());
}

TEST_F(LpipsHookTest, WithWeightsIsTheMeanOverTheViewsAndNamesItsWeights) {
  const Json description = weights("aa");
  const Comparison comparison = run_evaluation(request(description));
  EXPECT_EQ(calls_, 4) << "one per view";
  EXPECT_DOUBLE_EQ(comparison.results[0][0].value("lpips"), 0.25);
  EXPECT_DOUBLE_EQ(metrics()["summary"]["lpips"]["mean"].get<double>(), 0.25);
  EXPECT_EQ(metrics()["settings"]["lpips"], description);
}

TEST_F(LpipsHookTest, SavedResultsCountOnlyForTheSameWeights) {
  run_evaluation(request(weights("aa")));
  run_evaluation(request(weights("aa")));
  EXPECT_EQ(calls_, 4) << "the second run resumes";
  run_evaluation(request(weights("cc")));
  EXPECT_EQ(calls_, 8);
  EXPECT_EQ(run_evaluation(request(nullptr)).results[0][0].values.count("lpips"), 0u);
}

TEST_F(LpipsHookTest, ADistanceWithoutADescriptionIsRefused) {
  EvaluationRequest nameless = request(weights("aa"));
  nameless.settings.lpips = nullptr;
  EXPECT_THROW(run_evaluation(nameless), Error);
  nameless = request(nullptr);
  nameless.settings.image_encoder = weights("aa");
  EXPECT_THROW(run_evaluation(nameless), Error);
}

TEST_F(LpipsHookTest, TheDistanceOfAnImageEncoderIsAMetricOfItsOwn) {
  EvaluationRequest encoded = request(nullptr);
  encoded.settings.image_encoder = weights("bb");
  encoded.perceptual.encoder = [](const io::Image&, const io::Image&) { return 0.125; };
  const Comparison comparison = run_evaluation(encoded);
  EXPECT_DOUBLE_EQ(comparison.results[0][0].value("encoder_distance"), 0.125);
  EXPECT_EQ(comparison.results[0][0].not_computed.count("lpips"), 1u);
  EXPECT_EQ(metrics()["settings"]["image_encoder"], weights("bb"));
  EXPECT_EQ(run_evaluation(request(nullptr)).results[0][0].not_computed.at("encoder_distance"),
            "no image encoder given");
}

}  // namespace

}  // namespace anigen::eval
