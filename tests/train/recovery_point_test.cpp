#include "anigen/train/recovery_point.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/train/parameter_update.h"
#include "anigen/train/trainer.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

/// The base rate, but for one step at which finite gradients make weights that are not finite.
struct Burst : LrSchedule {
  explicit Burst(std::int64_t at) : at(at) {}
  double rate(double base, std::int64_t step) const override {
    return step == at ? std::numeric_limits<double>::infinity() : base;
  }
  std::int64_t at;
};

/// fp32 and fp16 weights, so that both ways from the master to the model are covered.
struct MixedImpl : torch::nn::Module {
  MixedImpl() {
    torch::manual_seed(2);
    single = register_parameter("single", torch::randn({5}));
    half = register_parameter("half", torch::randn({3}).to(torch::kHalf));
  }
  torch::Tensor single, half;
};

class RecoveryTest : public ::testing::Test {
 protected:
  RecoveryTest() : model_(std::make_shared<MixedImpl>()), buffer_({{"m", model_}}) { options_.ema_rates = {0.5}; }

  ParameterUpdate::Result apply(ParameterUpdate& update, std::int64_t step) {
    torch::Tensor gradient = buffer_.gradient();
    torch::manual_seed(static_cast<std::uint64_t>(step));
    gradient.copy_(torch::randn_like(gradient));
    return update.apply(step);
  }

  std::shared_ptr<MixedImpl> model_;
  ParameterBuffer buffer_;
  UpdateOptions options_;
};

TEST_F(RecoveryTest, GoesBackToTheLastTenthStepAndOn) {
  options_.schedule = std::make_shared<Burst>(13);
  ParameterUpdate update(buffer_, options_);
  torch::Tensor tenth, average;
  for (std::int64_t step = 0; step < 13; ++step) {
    if (step == 10) tenth = buffer_.master().clone();
    EXPECT_FALSE(apply(update, step).restored) << step;
  }
  ASSERT_FALSE(torch::equal(buffer_.master(), tenth));
  average = update.ema.averages()[0].clone();
  const std::int64_t optimizer_steps = update.optimizer.steps;

  EXPECT_TRUE(apply(update, 13).restored);
  EXPECT_EQ(update.recovery.step(), 10);
  EXPECT_TRUE(torch::equal(buffer_.master(), tenth));
  EXPECT_TRUE(torch::equal(model_->single, tenth.slice(0, 0, 5)));
  EXPECT_TRUE(torch::equal(model_->half, tenth.slice(0, 5, 8).to(torch::kHalf)));
  EXPECT_TRUE(torch::allclose(update.ema.averages()[0], 0.5 * average + 0.5 * tenth)) << "averages come after recovery";
  EXPECT_EQ(update.optimizer.steps, optimizer_steps + 1) << "the optimiser is not set back";

  EXPECT_FALSE(apply(update, 14).restored);
  EXPECT_FALSE(torch::equal(buffer_.master(), tenth));
  for (std::int64_t step = 15; step <= 20; ++step) apply(update, step);
  EXPECT_EQ(update.recovery.step(), 20);
}

TEST_F(RecoveryTest, TheTenthStepItselfCanBeUndone) {
  options_.schedule = std::make_shared<Burst>(0);
  ParameterUpdate update(buffer_, options_);
  const torch::Tensor start = buffer_.master().clone();
  EXPECT_TRUE(apply(update, 0).restored);
  EXPECT_TRUE(torch::equal(buffer_.master(), start));
}

TEST_F(RecoveryTest, IsAnErrorWhenThereIsNothingToGoBackTo) {
  options_.schedule = std::make_shared<Burst>(3);
  ParameterUpdate update(buffer_, options_);
  EXPECT_THROW(apply(update, 3), Error);
}

TEST_F(RecoveryTest, WeightsThatAreNotFiniteAreNeverKept) {
  RecoveryPoint recovery;
  torch::Tensor weights = torch::tensor({1.0f, 2.0f});
  recovery.before_update(0, weights);
  recovery.before_update(10, torch::tensor({1.0f, std::numeric_limits<float>::quiet_NaN()}));
  recovery.before_update(11, torch::tensor({5.0f, 6.0f}));
  EXPECT_EQ(recovery.step(), 0);
  // Finite weights whose sum overflows are no reason to go back.
  torch::Tensor huge = torch::full({2}, 3e38f);
  EXPECT_FALSE(recovery.after_update(11, huge));
  torch::Tensor opposite =
      torch::tensor({std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()});
  EXPECT_TRUE(recovery.after_update(12, opposite));
  EXPECT_TRUE(torch::equal(opposite, weights));
}

/// A loss that differs from step to step.
struct SmallStage : Stage, loaders::BatchSource {
  SmallStage() {
    torch::manual_seed(7);
    model = std::make_shared<torch::nn::LinearImpl>(2, 1);
  }
  std::shared_ptr<torch::nn::LinearImpl> model;
  std::vector<nn::NamedModel> models() const override { return {{"net", model}}; }
  const loaders::BatchSource& data() const override { return *this; }
  std::size_t size() const override { return 3; }
  std::unique_ptr<loaders::Batch> load(const std::vector<loaders::Draw>&) const override {
    auto batch = std::make_unique<loaders::Batch>();
    batch->ids.push_back("sample");
    return batch;
  }
  Losses losses(const loaders::Batch&, const LossContext& context) override {
    const auto step = static_cast<float>(context.step);
    torch::Tensor loss = (model->forward(torch::tensor({{1.0f, 0.1f * step}})) - 3.0).square().sum();
    return {loss, {{"square", loss}}};
  }
  std::unique_ptr<Stage> replica() const override { return std::make_unique<SmallStage>(*this); }
};

class RecoveryRun : public ::testing::Test {
 protected:
  void train(const std::string& output, std::int64_t max_steps) {
    SmallStage stage;
    TrainerOptions options;
    options.max_steps = max_steps;
    options.i_save = 1000;
    options.update.schedule = std::make_shared<Burst>(17);
    RunOptions run;
    run.output = folder_ / output;
    Trainer(stage, options, run).run();
  }
  std::string weights(const std::string& run, int step) {
    return read_file(CheckpointFolder(folder_ / run / "ckpts").file("net", step));
  }
  bool saves_the_clone(const std::string& run, int step) {
    const SavedState state = CheckpointFolder(folder_ / run / "ckpts").state(step);
    return io::find(state.arrays, "recovery.master") != nullptr;
  }
  test::TemporaryFolder folder_;
};

TEST_F(RecoveryRun, ResumedRunsRecoverToTheSameBits) {
  train("ten", 10);
  train("burst", 18);
  EXPECT_EQ(weights("burst", 18), weights("ten", 10)) << "step 17 goes back to the weights before step 10";
  train("whole", 30);
  train("legs", 16);
  EXPECT_TRUE(saves_the_clone("legs", 16));
  EXPECT_FALSE(saves_the_clone("ten", 10)) << "step 10 takes a new clone";
  train("legs", 30);
  EXPECT_EQ(weights("legs", 30), weights("whole", 30));
  train("ten", 30);
  EXPECT_EQ(weights("ten", 30), weights("whole", 30));
}

}  // namespace
}  // namespace anigen::train
