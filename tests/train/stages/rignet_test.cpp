#include "anigen/train/stages/rignet.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/rignet/dataset.h"
#include "anigen/train/stages/rig_stage.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer_state.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

constexpr char kRignetConfig[] = R"({
  "models": {"model": {"name": "RignetModel", "args": {"task": "joints", "width": 0.06, "dropout": 0.0}}},
  "dataset": {"name": "Rignet", "args": {"points": 64, "geodesic_samples": 100, "eval_fraction": 0.4}},
  "trainer": {"name": "RignetTrainer", "args": {
    "max_steps": 6, "batch_size": 3, "seed": 5, "clustering_from": 3, "mean_shifts": 4,
    "optimizer": {"name": "Adam", "args": {"lr": 0.003, "weight_decay": 1e-5}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_log": 1, "i_print": 0, "i_save": 3, "i_eval": 6, "i_sample": 6}}})";

class RignetRun : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_synthetic_dataset(folder_ / "data", 10);
    std::ofstream(folder_ / "config.json") << kRignetConfig;
  }
  static std::vector<std::string> of(const std::string& task) { return {"models.model.args.task=" + task}; }
  CsvTable metrics(const std::string& output) { return read_csv(folder_ / output / "metrics.csv"); }
  // The mean of a column's cells that are not empty, from one row to another.
  static double mean(const CsvTable& table, const std::string& column, std::size_t first, std::size_t last) {
    double sum = 0.0, count = 0.0;
    for (std::size_t r = first; r < last; ++r) {
      const std::string& cell = table.cell(r, column);
      if (cell.empty()) continue;
      sum += std::stod(cell);
      count += 1.0;
    }
    return count > 0.0 ? sum / count : std::nan("");
  }
  test::TemporaryFolder folder_;
};

TEST_F(RignetRun, EveryTaskTrainsIsEvaluatedAndScored) {
  const std::map<std::string, std::pair<std::string, std::string>> tasks = {
      {"joints", {"loss.clusters", "joints"}}, {"connectivity", {"loss.root", "recall"}}, {"skin", {"loss.ce", "cos"}}};
  for (const auto& [task, names] : tasks) {
    train(test::train_command(folder_, task, of(task)));
    const CsvTable table = metrics(task);
    EXPECT_TRUE(std::isfinite(mean(table, names.first, 0, table.rows.size()))) << task;
    EXPECT_TRUE(std::isfinite(mean(table, "eval." + names.second, 0, table.rows.size()))) << task;
    const CsvTable scores = read_csv(folder_ / task / "samples" / "step6" / "scores.csv");
    ASSERT_GT(scores.rows.size(), 0u) << task;
    EXPECT_EQ(scores.cell(0, "method"), "model");
    EXPECT_FALSE(scores.cell(0, names.second).empty()) << task;
  }
}

TEST_F(RignetRun, MeanShiftJoinsTheLossAtItsStep) {
  train(test::train_command(folder_, "run"));
  const CsvTable table = metrics("run");
  std::size_t steps = 0;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    if (table.cell(r, "loss.total").empty()) continue;  // of an evaluation
    const bool is_there = !table.cell(r, "loss.clusters").empty();
    EXPECT_EQ(is_there, steps++ >= 3) << r;
    const double chamfer = std::stod(table.cell(r, "loss.chamfer"));
    const double attention = std::stod(table.cell(r, "loss.attention"));
    const double wanted =
        is_there ? chamfer + 2.0 * std::stod(table.cell(r, "loss.clusters")) + 0.1 * attention : chamfer + attention;
    EXPECT_NEAR(std::stod(table.cell(r, "loss.total")), wanted, 1e-5) << r;
  }
  EXPECT_EQ(steps, 6u);
}

TEST_F(RignetRun, EveryTaskLearns) {
  for (const char* task : {"joints", "connectivity", "skin"}) {
    std::vector<std::string> longer = of(task);
    for (const char* more : {"trainer.args.max_steps=60", "trainer.args.clustering_from=1000", "trainer.args.i_eval=0",
                             "trainer.args.i_sample=0", "trainer.args.i_save=0"}) {
      longer.emplace_back(more);
    }
    train(test::train_command(folder_, task, longer));
    const CsvTable table = metrics(task);
    const std::size_t rows = table.rows.size();
    EXPECT_LT(mean(table, "loss.total", rows - 10, rows), 0.85 * mean(table, "loss.total", 0, 5)) << task;
  }
}

TEST_F(RignetRun, ARunThatWasStoppedEndsWithTheSameBits) {
  const std::vector<std::string> task = of("connectivity");  // draws the order of pairs
  train(test::train_command(folder_, "whole", task));
  std::vector<std::string> half = task;
  half.emplace_back("trainer.args.max_steps=3");
  train(test::train_command(folder_, "parts", half));
  torch::rand({17});  // what else drew must not matter
  train(test::train_command(folder_, "parts", task));
  const auto weights = [&](const std::string& output) {
    return CheckpointFolder(folder_ / output / "ckpts").weights("model", 6);
  };
  const io::NamedArrays whole = weights("whole"), parts = weights("parts");
  ASSERT_EQ(whole.size(), parts.size());
  for (std::size_t i = 0; i < whole.size(); ++i)
    EXPECT_EQ(whole[i].second.bytes, parts[i].second.bytes) << whole[i].first;
}

TEST(RignetConfigs, ShippedOnesAreWholeAndSmallOnesCanBeBuilt) {
  std::size_t files = 0;
  for (const char* folder : {"rignet", "rignet_tiny"}) {
    for (const auto& entry : fs::directory_iterator(test::source_dir() / "configs" / folder)) {
      const std::string file = entry.path().string();
      Json config = load_config(entry.path());
      const auto model = rignet::RignetOptions::from_json(config["models"]["model"]["args"], file);
      EXPECT_EQ(name_of(model.task), entry.path().stem().string()) << file;
      ConfigReader trainer(config["trainer"]["args"], file);
      const auto options = TrainerOptions::read(trainer);
      RignetStageOptions::read(trainer);
      EXPECT_NO_THROW(trainer.finish()) << file;
      EXPECT_EQ(options.replicas, 1u) << file;
      ConfigReader dataset(config["dataset"]["args"], file);
      rignet::RignetDatasetOptions::read(dataset);
      EXPECT_NO_THROW(dataset.finish()) << file;
      if (folder == std::string("rignet_tiny")) {
        EXPECT_NO_THROW(rignet::RignetModel{model}) << file;
      }
      ++files;
    }
  }
  EXPECT_EQ(files, 6u);
}

TEST_F(RignetRun, BadConfigsNameTheirPlace) {
  const auto message = [&](const std::string& override) -> std::string {
    try {
      train(test::train_command(folder_, "bad", {override}));
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message("trainer.args.replicas=2").find("replicas"), std::string::npos);
  EXPECT_NE(message("models.model.args.task=bones").find("connectivity"), std::string::npos);
  EXPECT_NE(message("dataset.args.most_vertexes=99").find("most_vertices"), std::string::npos);
}

TEST(RigScores, MeansLeaveOutWhatWasNotComputed) {
  RigScores scores;
  const std::vector<Eigen::Vector3d> truth = {{0, 0, 0}, {1, 0, 0}};
  scores.add_joints("one", {{0, 0, 0}, {1, 0, 0.2}}, truth);
  scores.add_joints("two", {{0, 0, 0}}, truth);
  std::map<std::string, double> means;
  for (const auto& [name, value] : scores.means()) means[name] = value;
  EXPECT_NEAR(means.at("cd"), 0.1, 1e-12) << "of the first alone";
  EXPECT_NEAR(means.at("precision"), 0.5, 1e-12);
  EXPECT_NEAR(means.at("skipped"), 0.5, 1e-12);
  EXPECT_EQ(scores.table().cell(1, "cd"), "");
}

TEST(RigScores, ParentsAndProbabilitiesAreJudgedApart) {
  const metrics::SkinMatrix truth = parent_rows({-1, 0, 1});
  const metrics::SkinMatrix even = metrics::SkinMatrix::Constant(3, 3, 1.0 / 3.0);
  RigScores scores;
  scores.add_connectivity("chain", even, truth, truth, {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}});
  std::map<std::string, double> means;
  for (const auto& [name, value] : scores.means()) means[name] = value;
  EXPECT_NEAR(means.at("ce"), std::log(3.0), 1e-5);
  EXPECT_GT(means.at("precision"), 0.6);
  EXPECT_EQ(means.count("tree_recall"), 1u);
}

}  // namespace
}  // namespace anigen::train
