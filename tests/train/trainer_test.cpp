#include "anigen/train/trainer.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <chrono>
#include <fstream>
#include <future>
#include <limits>
#include <optional>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/train/stages/stages.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer_state.h"
#include "tests/train/trainer_run.h"

namespace anigen::train {
namespace {

// Metrics without the columns that measure time.
std::string untimed(const std::filesystem::path& file) {
  const CsvTable table = read_csv(file);
  std::string text;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    for (std::size_t column = 0; column < table.columns.size(); ++column) {
      if (table.columns[column].rfind("time.", 0) != 0)
        text += table.columns[column] + "=" + table.rows[row][column] + " ";
    }
    text += "\n";
  }
  return text;
}

TEST_F(TrainerRun, TheRunFolderIsComplete) {
  train(command("run"));
  for (const char* file :
       {"config.json", "command.txt", "log.txt", "metrics.csv", "ckpts/model_step0000012.safetensors",
        "ckpts/model_ema0.99_step0000012.safetensors", "ckpts/state_step0000012.safetensors"}) {
    EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / file)) << file;
  }
  EXPECT_FALSE(std::filesystem::is_empty(folder_ / "run/tb_logs"));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  for (const char* column : {"loss.total", "loss.kl", "status.lr", "status.grad_norm", "eval.l1", "eval.kl"})
    EXPECT_NE(metrics.column(column), CsvTable::kMissing) << column;
}

TEST_F(TrainerRun, ARepeatedCommandAddsNoEvaluation) {
  const std::vector<std::string> seven = {"trainer.args.max_steps=7"};
  train(command("run", seven));
  const std::string metrics = bytes("run/metrics.csv");
  train(command("run", seven));
  EXPECT_EQ(bytes("run/metrics.csv"), metrics);
}

// A run that begins at another one's checkpoint has its own clock.
TEST_F(TrainerRun, ALoadedRunTakesOverNoTime) {
  train(command("first"));
  TrainCommand fork = command("fork", {"trainer.args.max_minutes=1e-9", "trainer.args.max_steps=14"});
  fork.run.load = folder_ / "first";
  train(fork);
  EXPECT_EQ(CheckpointFolder(folder_ / "fork/ckpts").steps().back(), 13) << "one step of its own";
}

TEST_F(TrainerRun, ResumedRunsEndWithTheSameBits) {
  train(command("whole"));
  // A first leg that is cut at step 7, three steps after its last checkpoint: it must go back to step 4.
  train(command("legs", {"trainer.args.max_steps=7", "trainer.args.i_save=4",
                         "trainer.args.lr_scheduler.schedulers.1.args.T_max=9"}));
  for (const char* name : {"state", "model", "model_ema0.99", "model_ema0.9"})
    std::filesystem::remove(folder_ / "legs/ckpts" / (std::string(name) + "_step0000007.safetensors"));
  train(command("legs"));
  for (const char* name : {"model", "model_ema0.99", "model_ema0.9"}) {
    const std::string file = std::string("ckpts/") + name + "_step0000012.safetensors";
    EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file)) << file;
  }
  EXPECT_EQ(untimed(folder_ / "whole/metrics.csv"), untimed(folder_ / "legs/metrics.csv"));
}

TEST_F(TrainerRun, AProfileStopsTheRunWhichGoesOnWithoutIt) {
  train(command("whole"));
  TrainCommand profiled = command("part");
  profiled.run.profile_steps = 3;  // after two that warm up
  train(profiled);
  EXPECT_NE(bytes("part/profile.md").find("GFLOP"), std::string::npos);
  train(command("part"));
  EXPECT_EQ(bytes("whole/ckpts/model_step0000012.safetensors"), bytes("part/ckpts/model_step0000012.safetensors"));
}

TEST_F(TrainerRun, DoublesAreKeptAndResumed) {
  const std::string fp64 = "trainer.args.precision=fp64", file = "ckpts/model_step0000012.safetensors";
  train(command("whole", {fp64}));
  train(command("legs", {fp64, "trainer.args.max_steps=8", "trainer.args.lr_scheduler.schedulers.1.args.T_max=9"}));
  train(command("legs", {fp64}));
  EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file));
  for (const auto& [name, array] : io::read_safetensors(folder_ / "whole" / file).tensors)
    EXPECT_EQ(array.dtype, io::Dtype::kF64) << name;
  train(command("narrow"));
  const double wide_loss = std::stod(read_csv(folder_ / "whole/metrics.csv").cell(0, "loss.total"));
  EXPECT_NEAR(wide_loss, std::stod(read_csv(folder_ / "narrow/metrics.csv").cell(0, "loss.total")), 1e-4);
}

TEST_F(TrainerRun, ReplicasGiveTheSameResultWhateverTheThreads) {
  TrainCommand one = command("one", {"trainer.args.replicas=2"}), two = command("two", {"trainer.args.replicas=2"});
  two.run.threads = 2;
  one.run.threads = 2;
  train(one);
  two.overrides.push_back("trainer.args.num_workers_dl=3");
  train(two);
  EXPECT_EQ(bytes("one/ckpts/model_step0000012.safetensors"), bytes("two/ckpts/model_step0000012.safetensors"));
  // One replica sums the same two gradients; only the order of additions inside the products may differ.
  train(command("single"));
  const auto a =
      io::find(CheckpointFolder(folder_ / "one/ckpts").weights("model", 12), "skin_decoder.out_layer_skin.2.weight")
          ->as<float>();
  const auto b =
      io::find(CheckpointFolder(folder_ / "single/ckpts").weights("model", 12), "skin_decoder.out_layer_skin.2.weight")
          ->as<float>();
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-3f);
}

TEST_F(TrainerRun, LearnsTheSyntheticRigs) {
  train(command("run", {"trainer.args.max_steps=150", "trainer.args.lr_scheduler=null", "trainer.args.i_eval=0"}));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  const auto loss = [&](std::size_t row) { return std::stod(metrics.cell(row, "loss.total")); };
  EXPECT_LT(loss(metrics.rows.size() - 1), 0.8 * loss(0));
}

TEST_F(TrainerRun, WarmStartAndCheckpointChoice) {
  train(command("first"));
  train(command("second", {"trainer.args.max_steps=0",
                           "trainer.args.finetune_ckpt={\"model\": \"" +
                               (folder_ / "first/ckpts/model_ema0.9_step0000012.safetensors").string() + "\"}"}));
  EXPECT_EQ(bytes("second/ckpts/model_step0000000.safetensors"),
            bytes("first/ckpts/model_ema0.9_step0000012.safetensors"));
  EXPECT_EQ(bytes("second/ckpts/model_ema0.99_step0000000.safetensors"),
            bytes("first/ckpts/model_ema0.9_step0000012.safetensors"))
      << "averages start from the warm start";
  TrainCommand from = command("third", {"trainer.args.max_steps=8"});
  from.run.load = folder_ / "first";
  from.run.ckpt = "8";
  train(from);
  EXPECT_EQ(bytes("third/ckpts/model_step0000008.safetensors"), bytes("first/ckpts/model_step0000008.safetensors"));
  from.run.output = folder_ / "fourth";
  from.run.ckpt = "9";
  EXPECT_THROW(train(from), InputError);
  for (const char* word : {"newest", "-1", ""}) {
    from.run.ckpt = word;
    from.run.output = folder_ / "fifth";
    EXPECT_THROW(train(from), InputError) << word;
    EXPECT_FALSE(std::filesystem::exists(from.run.output)) << word;
  }
  from.run.ckpt = "none";
  EXPECT_THROW(train(from), InputError) << "--load would be ignored";
  TrainCommand back = command("first", {"trainer.args.max_steps=8"});
  const std::string config = bytes("first/config.json");
  back.run.ckpt = "9";
  back.run.restart = true;
  try {
    train(back);
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(error.problem().find("8, 12"), std::string::npos) << error.problem();
  }
  EXPECT_EQ(bytes("first/config.json"), config) << "nothing is changed by a run that cannot begin";
  TrainCommand nowhere = command("first");
  nowhere.run.restart = true;
  EXPECT_THROW(train(nowhere), InputError) << "nothing says where to begin again";
  EXPECT_THROW(train(command("x", {"trainer.args.finetune_ckpt={\"decoder\": \"a.safetensors\"}"})), InputError);
}

constexpr char kSixSteps[] = "trainer.args.max_steps=6";

TEST_F(TrainerRun, ARunThatBeginsAgainKeepsItsOwnCheckpointAndTheEarlierOnes) {
  train(command("run"));
  const std::string earlier = bytes("run/ckpts/model_step0000012.safetensors"), config = bytes("run/config.json");
  TrainCommand anew = command("run", {"trainer.args.max_steps=3", "trainer.args.seed=6"});
  anew.run.ckpt = "none";
  anew.run.restart = true;
  train(anew);
  EXPECT_EQ(CheckpointFolder(folder_ / "run/ckpts").steps(), std::vector<std::int64_t>{3});
  EXPECT_EQ(CheckpointFolder(folder_ / "run/ckpts/abandoned-8-1").steps(), (std::vector<std::int64_t>{8, 12}));
  EXPECT_EQ(bytes("run/ckpts/abandoned-8-1/model_step0000012.safetensors"), earlier);
  EXPECT_EQ(bytes("run/ckpts/abandoned-8-1/config.json"), config);
  EXPECT_EQ(read_csv(folder_ / "run/ckpts/abandoned-8-1/metrics.csv").cell(0, "step"), "5");
  for (const auto& row : read_csv(folder_ / "run/metrics.csv").rows) EXPECT_LE(std::stoi(row[0]), 3);
  // The branch that was left can be continued.
  TrainCommand back = command("back", {"trainer.args.max_steps=12"});
  back.run.load = folder_ / "run/ckpts/abandoned-8-1";
  train(back);
  EXPECT_EQ(bytes("back/ckpts/model_step0000012.safetensors"), earlier);
}

TEST_F(TrainerRun, TheOutputsNewestCheckpointGoesBeforeLoadAndCkpt) {
  train(command("first", {"trainer.args.max_steps=4"}));
  for (const bool loads : {true, false}) {
    const std::string output = loads ? "loads" : "rewinds";
    TrainCommand leg = command(output, {kSixSteps});
    if (loads) {
      leg.run.load = folder_ / "first";
      leg.run.ckpt = "4";
    }
    train(leg);
    const CsvTable half = read_csv(folder_ / output / "metrics.csv");
    // An equal command with more to do, as after a kill, goes on.
    leg.overrides = {};
    leg.run.ckpt = "4";
    train(leg);
    EXPECT_NE(bytes(output + "/log.txt").find("is ignored: "), std::string::npos);
    EXPECT_NE(bytes(output + "/log.txt").find("resumed from step 6"), std::string::npos) << output;
    EXPECT_EQ(CheckpointFolder(folder_ / output / "ckpts").steps(), (std::vector<std::int64_t>{8, 12}));
    const CsvTable whole = read_csv(folder_ / output / "metrics.csv");
    ASSERT_GT(whole.rows.size(), half.rows.size());
    for (std::size_t row = 0; row < half.rows.size(); ++row)
      EXPECT_EQ(whole.cell(row, "time.elapsed_s"), half.cell(row, "time.elapsed_s")) << "rows are not written again";
  }
}

TEST_F(TrainerRun, ARewoundRunNeverGoesBackToTheBranchItLeft) {
  train(command("run"));
  TrainCommand rewound = command("run", {"trainer.args.max_steps=9", "trainer.args.seed=6"});
  rewound.run.ckpt = "8";
  rewound.run.restart = true;
  train(rewound);
  EXPECT_EQ(CheckpointFolder(folder_ / "run/ckpts").steps(), (std::vector<std::int64_t>{8, 9}));
  const std::string at_9 = bytes("run/ckpts/model_step0000009.safetensors");
  // Going on continues step 9, although the branch that was left had got to 12.
  train(command("run", {"trainer.args.max_steps=10", "trainer.args.seed=6"}));
  EXPECT_NE(bytes("run/log.txt").find("resumed from step 9"), std::string::npos);
  EXPECT_EQ(bytes("run/ckpts/model_step0000009.safetensors"), at_9);
  std::vector<int> steps;
  for (const auto& row : read_csv(folder_ / "run/metrics.csv").rows) steps.push_back(std::stoi(row[0]));
  EXPECT_TRUE(std::is_sorted(steps.begin(), steps.end())) << "one history";
  EXPECT_EQ(std::count(steps.begin(), steps.end(), 12), 0);
  const CsvTable left = read_csv(folder_ / "run/ckpts/abandoned-12-1/metrics.csv");
  EXPECT_EQ(left.cell(left.rows.size() - 1, "step"), "12");
}

TEST_F(TrainerRun, TheSameRestartGoesOnUntilItsRunHasEnded) {
  train(command("run"));
  TrainCommand again = command("run", {"trainer.args.max_steps=6"});
  again.run.ckpt = "none";
  again.run.restart = true;
  // A restart that was cut after its save at step 4: its last save and the end are undone.
  train(again);
  for (const char* name : {"state", "model", "model_ema0.99", "model_ema0.9"})
    std::filesystem::remove(folder_ / "run/ckpts" / (std::string(name) + "_step0000006.safetensors"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run/restart.json")) << "that run has ended";
  write_file_atomically(folder_ / "run/restart.json", R"({"command": "anigen-train", "last_step": -1})");
  train(again);
  EXPECT_NE(bytes("run/log.txt").find("resumed from step 4"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run/ckpts/abandoned-4-1"));
  // Another command, and the same one after the end, begin again.
  write_file_atomically(folder_ / "run/restart.json", R"({"command": "another", "last_step": -1})");
  train(again);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/abandoned-4-1"));
  train(again);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/abandoned-4-2"));
}

// Flat, then linear to zero over the last quarter.
const char* const kFlat = R"(trainer.args.lr_scheduler={"name": "SequentialLR", "args": {"milestones": ["75%"]},
  "schedulers": [{"name": "ConstantLR", "args": {"factor": 1.0}},
                 {"name": "LinearLR", "args": {"start_factor": 1.0, "end_factor": 0.0, "total_iters": "25%"}}]})";

TEST_F(TrainerRun, AnExtendedRunEndsWithTheBitsOfOneThatWasLongFromTheStart) {
  train(command("long", {kFlat, "trainer.args.max_steps=24"}));
  train(command("extended", {kFlat, "trainer.args.max_steps=12", "trainer.args.i_save=1"}));
  // The rate falls after step 10, whose checkpoint stays although two are newer.
  EXPECT_EQ(CheckpointFolder(folder_ / "extended/ckpts").steps(), (std::vector<std::int64_t>{10, 11, 12}));
  TrainCommand longer = command("extended");
  longer.config.clear();
  longer.extend_to = 24;
  train(longer);
  EXPECT_NE(bytes("extended/log.txt").find("resumed from step 10"), std::string::npos);
  for (const char* name : {"model", "model_ema0.99", "model_ema0.9"}) {
    const std::string file = std::string("ckpts/") + name + "_step0000024.safetensors";
    EXPECT_EQ(bytes("long/" + file), bytes("extended/" + file)) << file;
  }
  const std::string at_end = bytes("extended/ckpts/model_step0000024.safetensors");
  train(longer);  // nothing is left to do, and nothing is done again
  EXPECT_EQ(bytes("extended/ckpts/model_step0000024.safetensors"), at_end);
  longer.extend_to = 12;
  EXPECT_THROW(train(longer), InputError);
}

TEST_F(TrainerRun, ARunWhoseRateFallsFromTheStartCannotBeExtended) {
  train(command("run", {R"(trainer.args.lr_scheduler={"name": "CosineAnnealingLR", "args": {"T_max": "100%"}})"}));
  TrainCommand longer = command("run");
  longer.config.clear();
  longer.extend_to = 24;
  EXPECT_THROW(train(longer), InputError);
}

TEST_F(TrainerRun, DamagedCheckpointsAreMovedAsideByARunThatBeginsFromNothing) {
  train(command("run", {kSixSteps}));
  for (const int step : {4, 6}) std::filesystem::remove(CheckpointFolder(folder_ / "run/ckpts").file("model", step));
  train(command("run", {kSixSteps}));
  EXPECT_EQ(CheckpointFolder(folder_ / "run/ckpts").steps(), (std::vector<std::int64_t>{4, 6}));
  EXPECT_TRUE(CheckpointFolder(folder_ / "run/ckpts/abandoned-4-1").has("model_ema0.9", 6));
}

TEST_F(TrainerRun, ARunFolderHasOneTrainer) {
  train(command("run", {kSixSteps}));
  const std::string config = bytes("run/config.json"), metrics = bytes("run/metrics.csv");
  const std::filesystem::path file = folder_ / "run/run.lock";
  std::optional<FileLock> other = FileLock::try_lock(file, FileLock::Kind::kExclusive);
  ASSERT_TRUE(other) << "the lock ends with the run";
  std::ofstream(file) << to_json(this_process()).dump();
  try {
    train(command("run"));
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const ProcessIdentity holder = this_process();
    EXPECT_EQ(error.file(), (folder_ / "run").string());
    EXPECT_NE(error.problem().find("process " + std::to_string(holder.id) + " on " + holder.host), std::string::npos)
        << error.problem();
  }
  EXPECT_EQ(bytes("run/config.json"), config) << "nothing is touched";
  EXPECT_EQ(bytes("run/metrics.csv"), metrics);
  // A holder on another machine may be gone, which the file system notices later: it is waited for.
  ProcessIdentity elsewhere = this_process();
  elsewhere.space = "another machine";
  std::ofstream(file) << to_json(elsewhere).dump();
  const std::future<void> ends = std::async(std::launch::async, [&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    other.reset();
  });
  train(command("run"));
  EXPECT_EQ(CheckpointFolder(folder_ / "run/ckpts").latest(), 12);
}

TEST_F(TrainerRun, AConfigAloneInTheRunFolderIsEnoughToGoOn) {
  train(command("run", {"trainer.args.max_steps=4"}));
  TrainCommand again;
  again.run.output = folder_ / "run";
  again.overrides = {"trainer.args.max_steps=6"};
  train(again);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/model_step0000006.safetensors"));
}

TEST_F(TrainerRun, TimeBudgetEndsARunEarlyAndSaves) {
  train(command("run", {"trainer.args.max_steps=1000000", "trainer.args.max_minutes=0.01"}));
  const auto latest = CheckpointFolder(folder_ / "run/ckpts").latest();
  ASSERT_TRUE(latest);
  EXPECT_LT(*latest, 1'000'000);
}

TEST_F(TrainerRun, BadConfigsNameTheKeyAndTouchNothing) {
  const auto message = [&](const std::string& override) {
    try {
      train(command("bad", {override}));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message("trainer.args.lambda_kl_skn=1").find("lambda_kl_skin"), std::string::npos);
  EXPECT_NE(message("trainer.args.augmentations.rotaton=z").find("rotation"), std::string::npos);
  EXPECT_NE(message("dataset.args.filter_bad_skn=true").find("filter_bad_skin"), std::string::npos);
  EXPECT_NE(message("models.model.args.encoder_config.jp_embed_dm=3").find("jp_embed_dim"), std::string::npos);
  EXPECT_NE(message("trainer.name=AniGenOtherTrainer").find("not supported"), std::string::npos);
  EXPECT_NE(message("trainer.args.batch_split=9").find("batch_split"), std::string::npos);
  EXPECT_NE(message("trainer.args.replicas=3").find("replicas"), std::string::npos);
  EXPECT_NE(message("modles={}").find("models"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "bad/ckpts"));
}

TEST_F(TrainerRun, PrecisionsAStageLacksAreFoundBeforeTheRunFolderIsWritten) {
  try {
    train(command("bf16", {"trainer.args.precision=bf16"}));
    FAIL() << "expected an error";
  } catch (const NotSupportedError& error) {
    EXPECT_EQ(error.file(), (folder_ / "config.json").string());
    EXPECT_EQ(error.place(), "/trainer/args/precision");
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "bf16"));
}

TEST_F(TrainerRun, AFineTuningFileWithoutAnyTensorOfTheModelIsAnError) {
  io::write_safetensors(folder_ / "other.safetensors",
                        {{"unrelated", io::NdArray::from(std::vector<float>{1.0F, 2.0F}, {2})}});
  EXPECT_THROW(train(command("run", {"trainer.args.finetune_ckpt={\"model\": \"" +
                                     (folder_ / "other.safetensors").string() + "\"}"})),
               InputError);
}

/// A stage whose loss or gradient goes bad at step 2.
struct BrokenStage : Stage, data::BatchSource {
  bool in_gradient = false;
  bool in_constant = false;  ///< a loss that is infinite while its gradient is not
  int warm_starts = 0;
  void warm_start(const LoadedKeys&) override { ++warm_starts; }
  std::shared_ptr<torch::nn::LinearImpl> model = std::make_shared<torch::nn::LinearImpl>(2, 1);
  std::vector<nn::NamedModel> models() const override { return {{"net", model}}; }
  const data::BatchSource& data() const override { return *this; }
  std::size_t size() const override { return 3; }
  std::unique_ptr<data::Batch> load(const std::vector<data::Draw>& draws) const override {
    auto batch = std::make_unique<data::Batch>();
    for (const data::Draw& draw : draws) batch->ids.push_back("sample" + std::to_string(draw.item));
    return batch;
  }
  Losses losses(const data::Batch&, const LossContext& context) override {
    torch::Tensor loss = model->forward(torch::ones({1, 2})).square().sum();
    // d/dx of sqrt at 0 is infinite although its value is not.
    if (context.step == 2 && in_constant) return {loss + std::numeric_limits<double>::infinity(), {{"square", loss}}};
    if (context.step == 2) loss = in_gradient ? loss + (model->weight * 0.0).abs().sqrt().sum() : loss * std::nan("");
    return {loss, {{"square", loss}}};
  }
  std::unique_ptr<Stage> replica() const override { return std::make_unique<BrokenStage>(*this); }
};

TEST_F(TrainerRun, ValuesThatAreNotFiniteStopTheRunAndNameWhatWasWrong) {
  for (const bool in_gradient : {false, true}) {
    BrokenStage stage;
    stage.in_gradient = in_gradient;
    TrainerOptions options;
    options.max_steps = 10;
    options.i_save = 2;
    RunOptions run;
    run.output = folder_ / (in_gradient ? "gradient" : "loss");
    Trainer trainer(stage, options, run);
    try {
      trainer.run();
      FAIL() << "expected an error";
    } catch (const Error& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find("step 2"), std::string::npos) << message;
      EXPECT_NE(message.find(in_gradient ? "net.weight" : "loss.total"), std::string::npos) << message;
      EXPECT_NE(message.find("sample"), std::string::npos) << message;
    }
    EXPECT_EQ(CheckpointFolder(run.output / "ckpts").latest(), 2);
    EXPECT_TRUE(torch::isfinite(stage.model->weight).all().item<bool>());
  }
}

/// A stage whose second evaluation loses the checkpoints.
struct LosingStage : BrokenStage {
  std::filesystem::path lost;
  int evaluations = 0;
  Losses losses(const data::Batch&, const LossContext&) override {
    const torch::Tensor loss = model->forward(torch::ones({1, 2})).square().sum();
    return {loss, {{"square", loss}}};
  }
  Values evaluate() override {
    if (++evaluations == 2) std::filesystem::remove_all(lost);
    return {};
  }
};

TEST_F(TrainerRun, ARunEndsOnlyWithItsCheckpoint) {
  LosingStage stage;
  TrainerOptions options;
  options.max_steps = options.i_save = 4;
  options.i_eval = 3;
  RunOptions run;
  run.output = folder_ / "run";
  stage.lost = run.output / "ckpts";
  Trainer trainer(stage, options, run);
  try {
    trainer.run();
    FAIL() << "expected an error";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("state_step0000004"), std::string::npos) << error.what();
  }
  EXPECT_EQ(stage.evaluations, 2);
}

TEST_F(TrainerRun, LossScalingSkipsStepsThatAreNotFinite) {
  for (const std::string& fault : {std::string("loss"), std::string("gradient"), std::string("constant")}) {
    BrokenStage stage;
    stage.in_gradient = fault == "gradient";
    stage.in_constant = fault == "constant";
    TrainerOptions options;
    options.max_steps = 10;
    options.update.loss_scaling = true;
    RunOptions run;
    run.output = folder_ / fault;
    Trainer trainer(stage, options, run);
    trainer.run();
    // From 15: a thousandth up in nine steps, one down in the bad one.
    EXPECT_NEAR(trainer.update().log_scale, 15.0 + 9 * 1e-3 - 1.0, 1e-9) << fault;
    EXPECT_EQ(trainer.update().optimizer.steps, 9) << fault;
    EXPECT_TRUE(torch::isfinite(stage.model->weight).all().item<bool>()) << fault;
    EXPECT_EQ(stage.warm_starts, 1);

    BrokenStage resumed;
    EXPECT_EQ(Trainer(resumed, options, run).step(), 10) << fault << ": what is logged must not spoil the saved state";
    EXPECT_EQ(resumed.warm_starts, 0) << "a checkpoint holds everything";
  }
}

TEST_F(TrainerRun, SaysWhatShareOfAStepWaitedForData) {
  train(command("run"));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  const double share = std::stod(metrics.cell(0, "time.data_share"));
  EXPECT_GE(share, 0.0);
  EXPECT_LT(share, 1.0);
}

}  // namespace
}  // namespace anigen::train
