#pragma once
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/train/distributed/communicator.h"
#include "anigen/train/trainer.h"
#include "tests/train/distributed/joined_ranks.h"

namespace anigen::test {

/// Weights of a rank when its training has ended; undefined when it failed.
struct RankOutcome {
  torch::Tensor master, gradient, average;
  std::exception_ptr error;
};

/// Trains stages of one config as ranks of this process. @param stages one per rank
inline std::vector<RankOutcome> train_on_ranks(const std::vector<std::unique_ptr<train::Stage>>& stages,
                                               const train::TrainerOptions& options,
                                               const std::filesystem::path& output) {
  std::vector<RankOutcome> outcomes(stages.size());
  const auto body = [&](const std::shared_ptr<train::Communicator>& ranks) {
    const auto rank = static_cast<std::size_t>(ranks->rank());
    train::RunOptions run;
    run.output = output;
    run.ranks = ranks;
    train::Trainer trainer(*stages[rank], options, run);
    try {
      trainer.run();
    } catch (const train::RankLost&) {
      throw;
    } catch (const std::exception& error) {
      ranks->leave(error.what());
      throw;
    }
    outcomes[rank] = {trainer.parameters().master().clone(), trainer.parameters().gradient().clone(),
                      trainer.update().ema.averages().front().clone(), nullptr};
  };
  if (stages.size() == 1) {
    body(std::make_shared<train::SingleProcess>());
    return outcomes;
  }
  const auto errors = run_ranks(static_cast<int>(stages.size()), [&](train::Communicator& ranks) {
    body(std::shared_ptr<train::Communicator>(&ranks, [](train::Communicator*) {}));  // run_ranks owns it
  });
  for (std::size_t rank = 0; rank < errors.size(); ++rank) outcomes[rank].error = errors[rank];
  return outcomes;
}

inline double largest_distance(const torch::Tensor& a, const torch::Tensor& b) {
  return (a - b).abs().max().item<double>();
}

/// A stage trains alike on 1, 2 and 4 ranks: the gradients of the first step agree in fp32, 50 steps do in fp64.
/// @param make a stage of the config, always with the same weights @param options of 4 micro-batches, without the rest
/// of the run (evaluations, samples)
inline void expect_ranks_agree(const std::function<std::unique_ptr<train::Stage>()>& make,
                               train::TrainerOptions options, const std::filesystem::path& folder) {
  options.i_eval = options.i_sample = options.i_print = options.i_save = 0;
  options.i_ddpcheck = 10;
  const auto outcomes = [&](int ranks, const std::string& output) {
    std::vector<std::unique_ptr<train::Stage>> stages;
    for (int rank = 0; rank < ranks; ++rank) stages.push_back(make());
    return train_on_ranks(stages, options, folder / (output + std::to_string(ranks)));
  };
  const auto compare = [&](const std::string& output, torch::Tensor RankOutcome::*part, double tolerance) {
    const torch::Tensor alone = outcomes(1, output).front().*part;
    EXPECT_GT(alone.abs().max().item<double>(), 1e-3) << output << ": nothing to compare";
    for (const int ranks : {2, 4}) {
      const auto all = outcomes(ranks, output);
      for (const RankOutcome& each : all) {
        ASSERT_EQ(message_of(each.error), "no error") << ranks;
        const double distance = largest_distance(each.*part, alone);
        EXPECT_LE(distance, tolerance) << output << ", " << ranks << " ranks";
        EXPECT_TRUE(torch::equal(each.master, all.front().master)) << "the same bits on all ranks";
      }
      ::testing::Test::RecordProperty(output + std::to_string(ranks),
                                      std::to_string(largest_distance(all.front().*part, alone) * 1e12) + "e-12");
    }
  };
  options.max_steps = 1;
  compare("first_step", &RankOutcome::gradient, 1e-6);
  options.max_steps = 50;
  options.compute_dtype = torch::kFloat64;
  compare("doubles", &RankOutcome::master, 1e-9);
}

}  // namespace anigen::test
