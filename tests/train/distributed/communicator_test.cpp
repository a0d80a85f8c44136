#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <set>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/train/distributed/communicator.h"
#include "anigen/train/distributed/gradient_buckets.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/stages.h"
#include "anigen/train/train_command.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/train/distributed/joined_ranks.h"
#include "tests/train/distributed/rank_outcomes.h"
#include "tests/train/distributed/skin_stage_config.h"

namespace anigen::train {

namespace {

using test::run_ranks;
using test::run_ranks_well;
using torch::Tensor;

// Values of one rank that no two ranks share.
Tensor values_of(int rank, std::int64_t count, torch::Dtype dtype = torch::kFloat32) {
  return (torch::arange(count, torch::kFloat64) * 0.37 + 100.0 * rank).sin().to(dtype);
}

TEST(Communicator, SumsGathersAndBroadcasts) {
  for (const int size : {2, 3}) {
    run_ranks_well(size, [&](Communicator& ranks) {
      EXPECT_EQ(ranks.size(), size);
      for (const torch::Dtype dtype : {torch::kFloat32, torch::kFloat64}) {
        Tensor expected = torch::zeros({1001}, dtype), sum = values_of(ranks.rank(), 1001, dtype);
        for (int rank = 0; rank < size; ++rank) expected += values_of(rank, 1001, dtype);
        ranks.start_sum(sum)->wait();
        EXPECT_TRUE(torch::allclose(sum, expected, 1e-6, 1e-6));
        EXPECT_NO_THROW(require_same_parameters(ranks, sum, "test")) << "the same bits on all ranks";
      }
      const std::vector<std::string> all = ranks.gather(std::string(static_cast<std::size_t>(ranks.rank()), 'x'));
      for (int rank = 0; rank < size; ++rank)
        EXPECT_EQ(all[static_cast<std::size_t>(rank)].size(), static_cast<std::size_t>(rank));
      Tensor from_first = torch::full({5}, static_cast<double>(ranks.rank()));
      ranks.broadcast(from_first);
      EXPECT_TRUE(torch::equal(from_first, torch::zeros({5})));
      ranks.barrier();
    });
  }
}

TEST(Communicator, SeveralSumsAreUnderWayAtOnce) {
  run_ranks_well(2, [](Communicator& ranks) {
    std::vector<Tensor> parts;
    std::vector<std::unique_ptr<PendingSum>> sums;
    for (int i = 0; i < 20; ++i) {
      parts.push_back(torch::full({100 + i}, static_cast<double>(i)));
      sums.push_back(ranks.start_sum(parts.back()));
    }
    for (int i = 20; i-- > 0;) {
      sums[static_cast<std::size_t>(i)]->wait();
      EXPECT_TRUE(torch::equal(parts[static_cast<std::size_t>(i)], torch::full({100 + i}, 2.0 * i)));
    }
  });
}

TEST(Communicator, RoundedSumsAreCloseAndTheSameEverywhere) {
  RankOptions options;
  options.sent = torch::kBFloat16;
  for (const int size : {2, 3}) {
    run_ranks_well(
        size,
        [&](Communicator& ranks) {
          Tensor expected = torch::zeros({1000}), sum = values_of(ranks.rank(), 1000);
          for (int rank = 0; rank < size; ++rank) expected += values_of(rank, 1000);
          ranks.start_sum(sum)->wait();
          EXPECT_TRUE(torch::allclose(sum, expected, 0.0, 0.01 * size)) << "bf16 has 8 bits";
          EXPECT_FALSE(torch::equal(sum, expected));
          EXPECT_NO_THROW(require_same_parameters(ranks, sum, "test"));
          Tensor exact = torch::full({2}, 1.0 + 1e-12, torch::kFloat64);
          ranks.start_sum(exact)->wait();
          EXPECT_TRUE(torch::equal(exact, torch::full({2}, size * (1.0 + 1e-12), torch::kFloat64))) << "never rounded";
          Tensor bad = torch::full({7}, ranks.rank() == 1 ? std::nan("") : 1.0);
          ranks.start_sum(bad)->wait();
          EXPECT_TRUE(torch::isnan(bad).all().item<bool>());
        },
        options);
  }
}

TEST(Communicator, DifferentParametersAreNamedOnEveryRank) {
  const auto errors = run_ranks(3, [](Communicator& ranks) {
    Tensor parameters = torch::ones({1000});
    require_same_parameters(ranks, parameters, "step 7");
    if (ranks.rank() == 1) parameters[500] = 1.0000001f;
    require_same_parameters(ranks, parameters, "step 8");
  });
  for (const std::exception_ptr& error : errors) {
    EXPECT_NE(test::message_of(error).find("step 8"), std::string::npos) << test::message_of(error);
    EXPECT_NE(test::message_of(error).find("of rank 1 differ"), std::string::npos) << test::message_of(error);
  }
}

TEST(Communicator, ARankThatGivesUpIsNamedWithItsReason) {
  RankOptions options;
  options.timeout = 20.0;
  const auto errors = run_ranks(
      3,
      [](Communicator& ranks) {
        ranks.barrier();
        if (ranks.rank() == 2) {
          ranks.leave("rank 2 stopped: the disk is full");
          return;
        }
        ranks.barrier();
      },
      options);
  for (const int rank : {0, 1}) {
    const std::string message = test::message_of(errors[static_cast<std::size_t>(rank)]);
    EXPECT_NE(message.find("the disk is full"), std::string::npos) << message;
    EXPECT_THROW(std::rethrow_exception(errors[static_cast<std::size_t>(rank)]), RankLost);
  }
}

TEST(Communicator, AUsedRendezvousIsRefused) {
  const test::TemporaryFolder folder;
  LaunchEnvironment environment;
  environment.size = 2;
  environment.launcher = "test";
  environment.rendezvous.file = (folder / "rendezvous").string();
  const auto join = [&](int rank) {
    environment.rank = rank;
    LaunchEnvironment own = environment;
    return std::thread([own] { join_ranks(own, {})->barrier(); });
  };
  std::thread first = join(0), second = join(1);
  first.join();
  second.join();
  environment.rank = 0;
  EXPECT_THROW(join_ranks(environment, {}), Error);
}

TEST(Communicator, OneProcessSendsNothing) {
  SingleProcess alone;
  Tensor values = torch::ones({3});
  alone.start_sum(values)->wait();
  alone.broadcast(values);
  EXPECT_TRUE(torch::equal(values, torch::ones({3})));
  EXPECT_EQ(alone.gather("a"), std::vector<std::string>{"a"});
  EXPECT_NO_THROW(require_same_parameters(alone, values, "test"));
  EXPECT_EQ(join_ranks({}, {})->size(), 1);
}

TEST(Checksum, SeesEveryBitAndTheOrder) {
  const Tensor values = torch::randn({1003});
  std::set<std::uint64_t> seen{checksum(values), checksum(values.flip(0)), checksum(values.slice(0, 0, 1002))};
  for (const int at : {0, 1, 7, 500, 1000, 1002}) {
    Tensor other = values.clone();
    other.data_ptr<float>()[at] = std::nextafter(other.data_ptr<float>()[at], 100.0f);
    seen.insert(checksum(other));
  }
  EXPECT_EQ(seen.size(), 9u);
  EXPECT_EQ(checksum(values), checksum(values.clone()));
}

}  // namespace

namespace {

using test::largest_distance;
using test::RankOutcome;
using torch::Tensor;

constexpr std::int64_t kInputs = 6, kOutputs = 3, kHidden = 16;

struct NumberedBatch : data::Batch {
  Tensor x;  // [B, kInputs] fp64
};

/// A small regression with random draws, in fp32 or fp64. A part of it is used by every second micro-batch only, so
/// that one rank of two never has its gradient.
struct RegressionStage : Stage, data::BatchSource {
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
  const data::BatchSource& data() const override { return *this; }
  std::size_t size() const override { return 11; }
  std::unique_ptr<data::Batch> load(const std::vector<data::Draw>& draws) const override {
    auto batch = std::make_unique<NumberedBatch>();
    std::vector<Tensor> rows;
    for (const data::Draw& draw : draws) {
      batch->ids.push_back("sample" + std::to_string(draw.item) + "@" + std::to_string(draw.position));
      rows.push_back((torch::arange(kInputs, torch::kFloat64) * (1.0 + static_cast<double>(draw.item))).sin() +
                     0.01 * static_cast<double>(draw.position % 7));
    }
    batch->x = torch::stack(rows);
    return batch;
  }
  Losses losses(const data::Batch& batch, const LossContext& context) override {
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

  // Batches that all stages of the process have seen, by step: ranks are threads here.
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
      for (const char* column : {"loss.total", "loss.square", "status.grad_norm"})
        EXPECT_NEAR(std::stod(ours.cell(row, column)), std::stod(alone.cell(row, column)), 1e-9) << "global means";
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
    return make_stage("AniGenSkinAETrainer", {config, "test", args, options, torch::kCPU});
  };
  test::expect_ranks_agree(make, read(), folder_ / "skin");
}

TEST_F(Ranks, ReplicasAndRanksGoTogether) {
  const RankOutcome one = train(1, torch::kFloat64, regression_options(10), "one").front();
  TrainerOptions options = regression_options(10);
  options.replicas = 2;
  for (const RankOutcome& each : train_well(2, torch::kFloat64, options, "both"))
    EXPECT_LE(largest_distance(each.master, one.master), 1e-12);
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
    for (const char* part : {"rank 1", "step 4", "loss.total", "sample"})
      EXPECT_NE(message.find(part), std::string::npos) << part << " in " << message;
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
