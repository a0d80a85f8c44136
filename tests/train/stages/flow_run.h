#pragma once
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/train/stage.h"
#include "tests/train/stages/published_sample.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::test {

/// Stages and runs of a flow's config on the published sample, whose last asset is held out ("held_out.txt"), and what
/// the stages of both flows promise alike. The config trains 12 steps of 4 items in 2 micro-batches.
class FlowRun : public ::testing::Test {
 protected:
  explicit FlowRun(std::string config);

  train::TrainCommand command(const std::string& output, std::vector<std::string> overrides = {});
  /// A stage as a run begins with it.
  std::unique_ptr<train::Stage> fresh_stage(const std::vector<std::string>& overrides = {});
  train::TrainerOptions trainer_options(const std::vector<std::string>& overrides = {}) const;
  /// A stage whose weights are all away from zero, where the published start has them: there every output is zero.
  std::unique_ptr<train::Stage> stage(const std::vector<std::string>& overrides = {});
  /// Of the error that a config gives.
  std::string message(const std::vector<std::string>& overrides);

  /// The two assets that are not held out.
  static std::unique_ptr<data::Batch> batch_of(const train::Stage& stage);
  static double total_loss(const train::Losses& losses) { return losses.total.item<double>(); }
  static double term(const train::Losses& losses, const std::string& name);
  std::string bytes(const std::string& file);
  /// The samples of a step, which TensorBoard must have too.
  io::Image sample_sheet(const std::string& run, int step);

  void expect_draws_named_by_seed_step_and_micro_batch();
  /// @param cond the pictures of the batch, which change
  void expect_dropped_conditions_not_to_see_the_picture(const data::Batch& batch, torch::Tensor& cond);
  /// Frozen branches need their file; with it a replica computes the same although it shares no trained parameter of
  /// them. @param pretrained name of the file
  void expect_frozen_branches_to_start_warm(const std::string& pretrained);
  /// @param columns that the log has
  void expect_falling_loss(const std::vector<std::string>& columns);
  void expect_same_bits_after_resuming(const std::vector<std::string>& overrides = {});
  void expect_close_bf16_with_full_masters();
  void expect_the_same_on_several_ranks();

  std::string config_;
  TemporaryFolder folder_;
  PublishedSample sample_{folder_ / "data"};
};

}  // namespace anigen::test
