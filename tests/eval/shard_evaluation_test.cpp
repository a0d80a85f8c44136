#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/eval/pairs_csv.h"
#include "anigen/io/rigs/samples.h"
#include "anigen/io/rigs/shard_writer.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;
using Ids = std::vector<std::string>;

/// An Articulation-XL shard of four samples, and what three programs predicted for them.
class ShardEvaluation : public testing::Test {
 protected:
  ShardEvaluation() {
    for (int i = 0; i < 4; ++i) {
      rigs_.emplace_back();
      rigs_.back().uuid = "uuid-" + std::to_string(i);
      rigs_.back().joints[4] += 0.1 * i;
    }
    test::write_articulation_xl(folder_ / "xl_test.npz", rigs_);
    for (const test::RigFile& rig : rigs_) test::write_glb(folder_ / "ours" / (rig.uuid + ".glb"), rig);
    // Files of one program in two formats; text rigs without their mesh, in the frame of the shard.
    test::write_glb(folder_ / "theirs" / "uuid-0.glb", rigs_[0]);
    for (const std::size_t i : {1u, 2u, 3u})
      test::write_quickly(folder_ / "theirs" / (rigs_[i].uuid + ".txt"), test::text_rig(rigs_[i]));
    for (const test::RigFile& rig : rigs_) {
      fs::create_directories(folder_ / "puppeteer");
      test::write_quickly(folder_ / "puppeteer" / (rig.uuid + ".txt"), test::text_rig(rig));
    }
  }

  EvaluationRequest request(const Ids& predictions) const {
    EvaluationRequest asked;
    for (const std::string& name : predictions) asked.predictions.push_back(name + "=" + (folder_ / name).string());
    asked.truth = folder_ / "xl_test.npz";
    asked.out = folder_ / "out";
    asked.report = false;
    asked.settings.poses = 1;
    asked.settings.groups = {"skeleton", "skin"};
    asked.settings.alignment.normalization = metrics::NormalizationMode::kTruth;
    asked.settings.alignment.icp = false;
    return asked;
  }

  static void expect_equal_rigs(const Comparison& comparison, std::size_t method) {
    for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
      const PairResult& result = comparison.results[method][i];
      EXPECT_NEAR(result.value("j2j"), 0.0, 1e-5) << comparison.methods[method] << " " << result.id << result.failure;
      EXPECT_NEAR(result.value("skin_l1"), 0.0, 1e-5) << comparison.methods[method] << " " << result.id;
    }
  }
  test::TemporaryFolder folder_;
  std::vector<test::RigFile> rigs_;
};

TEST_F(ShardEvaluation, FoldersOfSeveralFormatsInOneCommand) {
  EvaluationRequest asked = request({"ours", "theirs", "puppeteer"});
  set_prediction_axes({"puppeteer=z-up"}, asked);
  fs::create_directories(folder_ / "theirs");
  for (const std::size_t i : {1u, 2u, 3u}) {  // Y up, as text rigs are unless told otherwise
    test::RigFile turned = rigs_[i];
    for (std::size_t j = 0; j < turned.joints.size(); j += 3) {
      const double y = turned.joints[j + 1];
      turned.joints[j + 1] = turned.joints[j + 2];
      turned.joints[j + 2] = -y;
    }
    test::write_quickly(folder_ / "theirs" / (turned.uuid + ".txt"), test::text_rig(turned));
  }
  const Comparison comparison = run_evaluation(asked);
  EXPECT_EQ(comparison.ids, (Ids{"uuid-0", "uuid-1", "uuid-2", "uuid-3"}));
  for (std::size_t m = 0; m < 3; ++m) expect_equal_rigs(comparison, m);
}

TEST_F(ShardEvaluation, AxesAreOfOnePredictionOrOfAll) {
  EvaluationRequest asked = request({"ours", "puppeteer"});
  set_prediction_axes({"z-up", "ours=format"}, asked);
  expect_equal_rigs(run_evaluation(asked), 0);
  expect_equal_rigs(run_evaluation(asked), 1);
  EvaluationRequest other = request({"ours"});
  const auto problem = [&](const Ids& words) {
    return test::refusal([&] {
      EvaluationRequest fresh = request({"ours"});
      set_prediction_axes(words, fresh);
      run_evaluation(fresh);
    });
  };
  EXPECT_EQ(problem({"their=z-up"}), "--pred-up: no --pred is called 'their'; there are ours");
  EXPECT_NE(problem({"z-up", "y-up"}).find("is given twice"), std::string::npos);
  EXPECT_NE(problem({"ours=z-up", "ours=y-up"}).find("is given twice"), std::string::npos);
  EXPECT_NE(problem({"ours=up"}), "");
}

TEST_F(ShardEvaluation, ACsvPointsIntoShards) {
  test::write_articulation_xl(folder_ / "pred" / "a.npz", {rigs_[1], rigs_[0]});
  test::write_anymate(folder_ / "pred" / "b.pt", {test::per_bone(rigs_[2])});
  test::write_quickly(folder_ / "cut.npz", read_file(folder_ / "xl_test.npz", 1 << 20).substr(0, 900));
  test::write_quickly(folder_ / "pairs.csv",
                      "pred,gt\npred/a.npz#uuid-0,xl_test.npz#uuid-0\npred/a.npz#0,xl_test.npz#1\n"
                      "pred/b.pt#0,xl_test.npz#uuid-2\npred/a.npz#7,xl_test.npz#uuid-3\ncut.npz#0,cut.npz#1\n"
                      "none.npz#1,xl_test.npz#3\npred/a.npz,xl_test.npz#2\n");
  EvaluationRequest asked = request({});
  asked.predictions = {"csv=" + (folder_ / "pairs.csv").string()};
  asked.truth.clear();
  const Comparison comparison = run_evaluation(asked);
  EXPECT_EQ(comparison.ids, (Ids{"uuid-0", "xl_test#1", "uuid-2", "uuid-3", "cut#1", "xl_test#3", "xl_test#2"}));
  const auto& rows = comparison.results[0];
  for (const std::size_t i : {0u, 1u}) EXPECT_NEAR(rows[i].value("j2j"), 0.0, 1e-5) << rows[i].failure;
  EXPECT_EQ(rows[2].failure, "");
  EXPECT_NE(rows[3].failure.find("is the number of no sample: it holds 2"), std::string::npos) << rows[3].failure;
  EXPECT_NE(rows[4].failure.find("zip archive"), std::string::npos) << rows[4].failure;
  EXPECT_NE(rows[5].failure.find("is missing"), std::string::npos) << rows[5].failure;
  EXPECT_NE(rows[6].failure.find("holds 2 shapes, a pair needs one: name it, as in a.npz#uuid-1"), std::string::npos)
      << rows[6].failure;
}

TEST_F(ShardEvaluation, ADamagedSampleIsARow) {
  rigs_[1].joints[3] = std::nan("");
  rigs_[2].faces[0] = 77;
  test::write_articulation_xl(folder_ / "xl_test.npz", rigs_);
  const Comparison comparison = run_evaluation(request({"ours"}));
  EXPECT_NE(comparison.results[0][1].failure.find("sample uuid-1, joints"), std::string::npos)
      << comparison.results[0][1].failure;
  EXPECT_NE(comparison.results[0][2].failure.find("names vertex 77"), std::string::npos);
  for (const std::size_t i : {0u, 3u}) EXPECT_NEAR(comparison.results[0][i].value("j2j"), 0.0, 1e-5);
}

TEST_F(ShardEvaluation, OneAssetTwiceIsRefused) {
  test::write_articulation_xl(folder_ / "xl_test.npz", {rigs_[0], rigs_[0]});
  EXPECT_NE(test::refusal([&] { run_evaluation(request({"ours"})); }).find("appears twice"), std::string::npos);
  test::write_quickly(folder_ / "pairs.csv", "pred,gt\n,xl_test.npz#uuid-0\n,xl_test.npz#uuid-0\n");
  EXPECT_EQ(test::refusal([&] { read_pairs_csv(folder_ / "pairs.csv"); }),
            "row 2: the id uuid-0 appears twice; give each row one in a column id");
}

TEST_F(ShardEvaluation, WhatIsWrittenIntoAShardIsAtNoDistance) {
  const auto source = io::open_source(folder_ / "xl_test.npz");
  for (const char* name : {"written.npz", "written.pt"}) {
    const auto writer = io::open_shard_writer(folder_ / name, 4);
    for (const std::string& id : source->ids()) writer->add(source->read(id), id);
    writer->finish();
  }
  EvaluationRequest asked = request({"written.npz"});
  asked.settings.alignment.normalization = metrics::NormalizationMode::kBoundingBox;
  expect_equal_rigs(run_evaluation(asked), 0);
}

}  // namespace
}  // namespace anigen::eval
