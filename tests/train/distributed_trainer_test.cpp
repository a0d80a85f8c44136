#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "anigen/core/config_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/stages.h"
#include "tests/loaders/synthetic_dataset.h"
#include "tests/train/rank_outcomes.h"
#include "tests/train/skin_stage_config.h"

namespace anigen::train {
namespace {

using test::largest_distance;
using test::RankOutcome;
using torch::Tensor;

constexpr std::int64_t kInputs = 6, kOutputs = 3, kHidden = 16;

struct NumberedBatch : loaders::Batch {
  Tensor x;  // [B, kInputs] fp64
};

/// A small regression with random draws, in fp32 or fp64. A part of it is used by every second micro-batch only, so
/// that one rank of two never has its gradient.
struct RegressionStage : Stage, loaders::BatchSource {
  explicit RegressionStage(torch::Dtype type) : dtype(type) {
    const torch::NoGradGuard no_grad;
    double seed = 0.1;
    for (Tensor parameter : model->parameters()) {
      parameter.copy_((torch::arange(parameter.numel(), torch::kFloat64) * (1.3 + seed)).sin().view(parameter.sizes()));
      parameter.mul_(0.4);
      seed += 0.37;
    }
    model->to(dtype);
  }
  std::vector<nn::NamedModel> models() const override { return {{"net", model.ptr()}}; }
  const loaders::BatchSource& data() const override { return *this; }
  std::size_t size() const override { return 11; }
  std::unique_ptr<loaders::Batch> load(const std::vector<loaders::Draw>& draws) const override {
    auto batch = std::make_unique<NumberedBatch>();
    std::vector<Tensor> rows;
    for (const loaders::Draw& draw : draws) {
      batch->ids.push_back("sample" + std::to_string(draw.item) + "@" + std::to_string(draw.position));
      rows.push_back((torch::arange(kInputs, torch::kFloat64) * (1.0 + static_cast<double>(draw.item))).sin() +
                     0.01 * static_cast<double>(draw.position % 7));
    }
    batch->x = torch::stack(rows);
    return batch;
  }
  Losses losses(const loaders::Batch& batch, const LossContext& context) override {
    const Tensor x = dynamic_cast<const NumberedBatch&>(batch).x.to(dtype);
    {
      const std::lock_guard<std::mutex> lock(mutex());
      for (const std::string& id : batch.ids) seen()[context.step].push_back(id);
    }
    const Tensor noise =
        torch::randn({x.size(0), kInputs}, loss_generator(context, "regression"), torch::kFloat64).to(dtype);
    Tensor y = first->forward(torch::tanh(hidden->forward(x + 0.1 * noise)));
    if (context.micro_batch % 2 == 0) y = y + sometimes->forward(x);
    Tensor loss = (y - x.slice(1, 0, kOutputs)).square().mean();
    if (context.step == bad_step && context.micro_batch == 1) loss = loss * std::nan("");
    return {loss, {{"square", loss}}};
  }
  std::unique_ptr<Stage> replica() const override { return std::make_unique<RegressionStage>(dtype); }

  // What all stages of the process have seen, by step: ranks are threads here.
  static std::map<std::int64_t, std::vector<std::string>>& seen() {
    static std::map<std::int64_t, std::vector<std::string>> ids;
    return ids;
  }
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }

  torch::Dtype dtype;
  std::int64_t bad_step = -1;
  torch::nn::Linear hidden{kInputs, kHidden}, first{kHidden, kOutputs}, sometimes{kInputs, kOutputs};
  torch::nn::Sequential model{hidden, first, sometimes};
};

TrainerOptions regression_options(std::int64_t steps) {
  TrainerOptions options;
  options.max_steps = steps;
  options.batch_size = 8;
  options.batch_split = 4;
  options.seed = 3;
  options.update.optimizer.lr = 1e-2;
  options.update.grad_clip = 0.5;
  options.update.ema_rates = {0.9};
  options.i_ddpcheck = 5;
  options.i_log = 10;
  options.i_print = options.i_sample = options.i_save = 0;
  return options;
}

class Ranks : public ::testing::Test {
 protected:
  // Trains on so many ranks into one run folder. @return what each rank holds at the end
  std::vector<RankOutcome> train(int size, torch::Dtype dtype, const TrainerOptions& options, const std::string& output,
                                 std::int64_t bad_step = -1) {
    std::vector<std::unique_ptr<Stage>> stages;
    for (int rank = 0; rank < size; ++rank) {
      auto stage = std::make_unique<RegressionStage>(dtype);
      stage->bad_step = bad_step;
      stages.push_back(std::move(stage));
    }
    return test::train_on_ranks(stages, options, folder_ / output);
  }
  std::vector<RankOutcome> train_well(int size, torch::Dtype dtype, const TrainerOptions& options,
                                      const std::string& output) {
    auto outcomes = train(size, dtype, options, output);
    for (const RankOutcome& each : outcomes) EXPECT_EQ(test::message_of(each.error), "no error");
    return outcomes;
  }

  test::TemporaryFolder folder_;
};

TEST_F(Ranks, GradientsOfTheFirstStepAgree) {
  const RankOutcome one = train(1, torch::kFloat32, regression_options(1), "one").front();
  EXPECT_GT(one.gradient.abs().max().item<double>(), 1e-2);
  for (const int size : {2, 4}) {
    for (const RankOutcome& each :
         train_well(size, torch::kFloat32, regression_options(1), "r" + std::to_string(size))) {
      EXPECT_LE(largest_distance(each.gradient, one.gradient), 1e-6) << size;
    }
  }
}

TEST_F(Ranks, FiftyStepsInDoublePrecisionAgree) {
  const RankOutcome one = train(1, torch::kFloat64, regression_options(50), "one").front();
  EXPECT_EQ(one.master.scalar_type(), torch::kFloat64);
  for (const int size : {2, 4}) {
    const auto all = train_well(size, torch::kFloat64, regression_options(50), "r" + std::to_string(size));
    for (const RankOutcome& each : all) {
      EXPECT_LE(largest_distance(each.master, one.master), 1e-9) << size;
      EXPECT_TRUE(torch::equal(each.master, all.front().master)) << "the same bits on all ranks";
      EXPECT_TRUE(torch::equal(each.average, all.front().average));
    }
    const CsvTable ours = read_csv(folder_ / ("r" + std::to_string(size)) / "metrics.csv");
    const CsvTable alone = read_csv(folder_ / "one" / "metrics.csv");
    ASSERT_EQ(ours.rows.size(), alone.rows.size());
    for (std::size_t row = 0; row < ours.rows.size(); ++row) {
      for (const char* column : {"loss.total", "loss.square", "status.grad_norm"}) {
        EXPECT_NEAR(std::stod(ours.cell(row, column)), std::stod(alone.cell(row, column)), 1e-9) << "global means";
      }
    }
  }
}

TEST_F(Ranks, TheSkinAutoEncoderTrainsAlike) {
  test::write_synthetic_dataset(folder_ / "data", 8);
  Json config = parse_json(test::kSkinStageConfig, "test");
  config["dataset"]["args"]["data_dir"] = (folder_ / "data").string();
  const auto read = [&] {
    ConfigReader args(config.at("trainer").at("args"), "test", "/trainer/args");
    return TrainerOptions::read(args);
  };
  const auto make = [&] {
    torch::manual_seed(5);
    const TrainerOptions options = read();
    ConfigReader args(config.at("trainer").at("args"), "test", "/trainer/args");
    TrainerOptions::read(args);
    return make_stage("AniGenSkinAETrainer", config, "test", args, options, torch::kCPU);
  };
  test::expect_ranks_agree(make, read(), folder_ / "skin");
}

TEST_F(Ranks, ReplicasAndRanksGoTogether) {
  const RankOutcome one = train(1, torch::kFloat64, regression_options(10), "one").front();
  TrainerOptions options = regression_options(10);
  options.replicas = 2;
  for (const RankOutcome& each : train_well(2, torch::kFloat64, options, "both")) {
    EXPECT_LE(largest_distance(each.master, one.master), 1e-12);
  }
}

TEST_F(Ranks, AnotherNumberOfRanksGoesOnWithTheSameData) {
  RegressionStage::seen().clear();
  const RankOutcome whole = train(1, torch::kFloat64, regression_options(12), "whole").front();
  auto expected = RegressionStage::seen();
  for (auto& [step, ids] : expected) std::sort(ids.begin(), ids.end());
  for (const int then : {1, 3}) {
    RegressionStage::seen().clear();
    const std::string output = "legs" + std::to_string(then);
    train_well(2, torch::kFloat64, regression_options(6), output);
    const RankOutcome last = train_well(then, torch::kFloat64, regression_options(12), output).front();
    for (auto& [step, ids] : RegressionStage::seen()) std::sort(ids.begin(), ids.end());
    EXPECT_EQ(RegressionStage::seen(), expected) << "each step the same samples, each of them once";
    EXPECT_LE(largest_distance(last.master, whole.master), 1e-10);
  }
}

TEST_F(Ranks, ALossThatIsNotFiniteIsNamedOnAllRanks) {
  for (const RankOutcome& each : train(2, torch::kFloat32, regression_options(10), "bad", /*bad_step=*/4)) {
    const std::string message = test::message_of(each.error);
    for (const char* part : {"rank 1", "step 4", "loss.total", "sample"}) {
      EXPECT_NE(message.find(part), std::string::npos) << part << " in " << message;
    }
    EXPECT_EQ(message.find("rank 0"), std::string::npos) << message;
  }
}

TEST_F(Ranks, TooFewMicroBatchesSayWhatToSet) {
  TrainerOptions options = regression_options(2);
  options.batch_split = 2;
  for (const RankOutcome& each : train(3, torch::kFloat32, options, "few")) {
    const std::string message = test::message_of(each.error);
    EXPECT_NE(message.find("batch_split"), std::string::npos) << message;
    EXPECT_NE(message.find("3 micro-batches"), std::string::npos) << message;
  }
}

}  // namespace
}  // namespace anigen::train
