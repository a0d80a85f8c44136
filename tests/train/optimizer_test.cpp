#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <memory>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/train/optimizer.h"
#include "anigen/train/options.h"
#include "anigen/train/parameters.h"
#include "anigen/train/trainer.h"
#include "tests/support/kernel_forms.h"
#include "tests/support/paths.h"

namespace anigen::train {

namespace {

double largest_difference(const torch::Tensor& a, const torch::Tensor& b) { return (a - b).abs().max().item<double>(); }

// torch's own implementation is the reference; both round in fp32, so a few units in the last place remain.
KERNEL_TEST(AdamW, FollowsTorch) {
  torch::manual_seed(1);
  const torch::Tensor start = torch::randn({1003});
  torch::Tensor mine = start.clone(), theirs = start.clone().set_requires_grad(true);
  AdamW::Options options;
  options.lr = 0.01;
  options.betas = {0.8, 0.95};
  options.weight_decay = 0.1;
  AdamW optimizer(mine, options);
  torch::optim::AdamW reference({theirs}, torch::optim::AdamWOptions(0.01).betas({0.8, 0.95}).weight_decay(0.1));
  for (int step = 0; step < 30; ++step) {
    const torch::Tensor gradient = torch::randn({1003});
    optimizer.step(mine, gradient, 0.5, 0.01);
    theirs.mutable_grad() = gradient * 0.5;
    reference.step();
  }
  EXPECT_LT(largest_difference(mine, theirs.detach()), 2e-6);
  EXPECT_GT(largest_difference(mine, start), 0.05) << "the comparison must be about something";
}

TEST(AdamW, WithoutDecouplingItIsTorchsAdam) {
  torch::manual_seed(2);
  torch::Tensor mine = torch::randn({501}), theirs = mine.clone().set_requires_grad(true);
  AdamW::Options options;
  options.lr = 0.01;
  options.weight_decay = 0.3;
  options.decoupled = false;
  AdamW optimizer(mine, options);
  torch::optim::Adam reference({theirs}, torch::optim::AdamOptions(0.01).weight_decay(0.3));
  for (int step = 0; step < 20; ++step) {
    const torch::Tensor gradient = torch::randn({501});
    optimizer.step(mine, gradient, 1.0, 0.01);
    theirs.mutable_grad() = gradient.clone();
    reference.step();
  }
  EXPECT_LT(largest_difference(mine, theirs.detach()), 2e-6);
}

TEST(AdamW, LearningRateIsTheCallersAndOptionsAreChecked) {
  torch::Tensor p = torch::ones({4});
  AdamW optimizer(p, {});
  optimizer.step(p, torch::ones({4}), 1.0, 0.0);
  EXPECT_EQ(largest_difference(p, torch::ones({4})), 0.0);
  AdamW::Options bad;
  bad.betas = {1.0, 0.9};
  EXPECT_THROW(AdamW(p, bad), InputError);
}

// Both passes give the same bits in every form of the kernels, so that a run continues on another machine as it was.
TEST(AdamW, EveryFormOfKernelsGivesTheSameBits) {
  torch::manual_seed(3);
  const torch::Tensor start = torch::randn({1003}), gradient = torch::randn({1003});
  std::vector<torch::Tensor> parameters, averages;
  test::in_every_kernel_form([&] {
    torch::Tensor now = start.clone();
    AdamW optimizer(now, {});
    Ema ema({0.9}, start);
    for (int step = 0; step < 5; ++step) {
      optimizer.step(now, gradient, 0.5, 0.01);
      ema.update(now);
    }
    parameters.push_back(now);
    averages.push_back(ema.averages()[0]);
  });
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    EXPECT_TRUE(torch::equal(parameters[i], parameters[0])) << i;
    EXPECT_TRUE(torch::equal(averages[i], averages[0])) << i;
  }
}

KERNEL_TEST(Ema, SeveralRatesFromACopyOfTheStart) {
  const torch::Tensor start = torch::tensor({1.0f, -2.0f});
  torch::Tensor now = torch::tensor({3.0f, 0.0f});
  Ema ema({0.9, 0.5}, start);
  ema.update(now);
  ema.update(now);
  EXPECT_LT(largest_difference(ema.averages()[0], now + 0.81 * (start - now)), 1e-6);
  EXPECT_LT(largest_difference(ema.averages()[1], now + 0.25 * (start - now)), 1e-6);
  EXPECT_THROW(Ema({1.0}, start), InputError);
}

// Of 50 updates at a rate of 0.998 the start keeps 90 %; with the warm-up of 50 steps 50! 9! / 59!, next to nothing.
KERNEL_TEST(Ema, AnUpdateTakesNoLargerRateThanItIsTold) {
  const torch::Tensor start = torch::full({5}, 100.0f), now = torch::arange(5).to(torch::kFloat32);
  Ema plain({0.998}, start), warmed({0.998}, start);
  for (int n = 0; n < 50; ++n) {
    plain.update(now);
    warmed.update(now, (1.0 + n) / (10.0 + n));
  }
  EXPECT_LT(largest_difference(plain.averages()[0], now + std::pow(0.998, 50) * (start - now)), 1e-3);
  EXPECT_LT(largest_difference(warmed.averages()[0], now), 1e-5);
}

struct TwoLayers : torch::nn::Module {
  torch::nn::Linear a{nullptr}, b{nullptr};
  TwoLayers() {
    a = register_module("a", torch::nn::Linear(3, 4));
    b = register_module("b", torch::nn::Linear(4, 2));
  }
  torch::Tensor loss(const torch::Tensor& x) { return b->forward(torch::tanh(a->forward(x))).square().sum(); }
};

TEST(ParameterBuffer, ViewsFollowTheMasterAndGradientsLandInTheFlatVector) {
  torch::manual_seed(2);
  auto model = std::make_shared<TwoLayers>();
  model->b->bias.set_requires_grad(false);
  const torch::Tensor weight_before = model->a->weight.detach().clone();
  ParameterBuffer buffer({{"m", model}});
  EXPECT_EQ(buffer.master().numel(), 12 + 4 + 8);
  EXPECT_EQ(buffer.slots()[0].name, "m.a.weight");
  EXPECT_EQ(largest_difference(model->a->weight, weight_before), 0.0);
  const torch::Tensor x = torch::randn({5, 3});
  for (int pass = 0; pass < 2; ++pass) {
    buffer.zero_gradients();
    model->loss(x).backward();
    buffer.collect_gradients();
  }
  auto plain = std::make_shared<TwoLayers>();
  torch::NoGradGuard no_grad;
  plain->a->weight.copy_(model->a->weight);
  plain->a->bias.copy_(model->a->bias);
  plain->b->weight.copy_(model->b->weight);
  plain->b->bias.copy_(model->b->bias);
  {
    torch::AutoGradMode grad(true);
    plain->loss(x).backward();
  }
  EXPECT_LT(largest_difference(buffer.part(buffer.gradient(), buffer.slots()[0]), plain->a->weight.grad()), 1e-6);
  torch::Tensor(buffer.master()).zero_();
  EXPECT_EQ(model->a->weight.abs().max().item<float>(), 0.0f);
}

TEST(ParameterBuffer, AReplicaSharesValuesAndKeepsItsOwnGradients) {
  auto model = std::make_shared<TwoLayers>(), twin = std::make_shared<TwoLayers>();
  ParameterBuffer buffer({{"m", model}});
  ParameterBuffer copy = buffer.share({{"m", twin}});
  EXPECT_EQ(largest_difference(twin->a->weight, model->a->weight), 0.0);
  twin->loss(torch::ones({1, 3})).backward();
  EXPECT_GT(copy.gradient().abs().max().item<float>(), 0.0f);
  EXPECT_EQ(buffer.gradient().abs().max().item<float>(), 0.0f);
  EXPECT_THROW(buffer.share({{"m", std::make_shared<torch::nn::LinearImpl>(3, 4)}}), Error);
}

TEST(ParameterUpdate, ANonFiniteGradientSkipsTheUpdateAndLowersTheScale) {
  auto model = std::make_shared<TwoLayers>();
  ParameterBuffer buffer({{"m", model}});
  UpdateOptions options;
  options.loss_scaling = true;
  options.grad_clip = AdaptiveGradClipper::Options{1.0, 95.0, 10};
  ParameterUpdate update(buffer, options);
  const torch::Tensor before = buffer.master().clone();
  torch::Tensor gradient = buffer.gradient();
  gradient[3] = std::nanf("");
  EXPECT_TRUE(update.apply(0).skipped);
  EXPECT_EQ(largest_difference(buffer.master(), before), 0.0);
  EXPECT_DOUBLE_EQ(update.log_scale, 14.0);
  EXPECT_EQ(update.optimizer.steps, 0);
  EXPECT_EQ(buffer.first_not_finite(buffer.gradient()), "m.a.weight");
  gradient.fill_(1024.0f);
  const auto result = update.apply(1);
  EXPECT_FALSE(result.skipped);
  EXPECT_NEAR(result.grad_norm, 1024.0 / 16384.0 * std::sqrt(static_cast<double>(gradient.numel())), 1e-5);
  EXPECT_DOUBLE_EQ(update.log_scale, 14.001);
}

}  // namespace

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(AdaptiveGradClipper, ThresholdMovesOnceTheBufferIsFull) {
  AdaptiveGradClipper clipper({100.0, 50.0, 3});
  EXPECT_DOUBLE_EQ(clipper.update(1), 1);
  EXPECT_DOUBLE_EQ(clipper.update(2), 1);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 100) << "two of three norms seen";
  clipper.update(9);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 2) << "median of 1, 2, 9";
  EXPECT_DOUBLE_EQ(clipper.update(8), 2 / (8 + 1e-6)) << "clipped at the threshold before this norm";
  EXPECT_DOUBLE_EQ(clipper.threshold(), 8) << "8 replaced 1: median of 8, 2, 9";
}

TEST(AdaptiveGradClipper, AChangedMaxNormCountsAtOnce) {
  AdaptiveGradClipper before({1.0, 50.0, 3}), lower({0.3, 50.0, 3}), higher({5.0, 50.0, 3});
  before.update(4);
  lower.restore(before.state());
  EXPECT_DOUBLE_EQ(lower.threshold(), 0.3);
  higher.restore(before.state());
  EXPECT_DOUBLE_EQ(higher.threshold(), 5) << "one of three norms seen";
  before.update(0.5);
  before.update(0.7);
  EXPECT_DOUBLE_EQ(before.threshold(), 0.7f) << "median of 4, 0.5, 0.7";
  lower.restore(before.state());
  EXPECT_DOUBLE_EQ(lower.threshold(), 0.3);
  higher.restore(before.state());
  EXPECT_DOUBLE_EQ(higher.threshold(), 0.7f);
}

TEST(AdaptiveGradClipper, MaxNormCapsTheThreshold) {
  AdaptiveGradClipper clipper({1.0, 95.0, 2});
  clipper.update(50);
  clipper.update(60);
  EXPECT_DOUBLE_EQ(clipper.threshold(), 1);
}

TEST(AdaptiveGradClipper, WithoutMaxNormNothingIsClippedAtFirst) {
  AdaptiveGradClipper clipper({std::nullopt, 95.0, 2});
  EXPECT_DOUBLE_EQ(clipper.update(1e6), 1);
  EXPECT_EQ(clipper.threshold(), kInfinity);
}

TEST(AdaptiveGradClipper, NormsThatAreNotFiniteAreNotRecorded) {
  AdaptiveGradClipper clipper({1.0, 95.0, 4});
  EXPECT_EQ(clipper.update(kInfinity), 0);
  EXPECT_TRUE(std::isnan(clipper.update(std::nan(""))));
  EXPECT_EQ(clipper.state().length, 0u);
}

TEST(AdaptiveGradClipper, RestoredStateContinuesTheSame) {
  AdaptiveGradClipper whole({5.0, 90.0, 4}), first({5.0, 90.0, 4}), second({5.0, 90.0, 4});
  const std::vector<double> norms{1, 3, 2, 4, 0.5, 2.5, 7, 1.5};
  for (const double norm : norms) whole.update(norm);
  for (std::size_t i = 0; i < 5; ++i) first.update(norms[i]);
  second.restore(first.state());
  for (std::size_t i = 5; i < norms.size(); ++i) second.update(norms[i]);
  EXPECT_EQ(second.threshold(), whole.threshold());
  EXPECT_EQ(second.state().buffer, whole.state().buffer);
  AdaptiveGradClipper other({5.0, 90.0, 3});
  EXPECT_THROW(other.restore(first.state()), InputError);
}

}  // namespace

namespace {

TEST(LrSchedule, PublishedWarmUpThenCosine) {
  const LrSchedule schedule = sequential_lr({linear_lr(1e-6, 1.0, 1000), cosine_annealing_lr(1'000'000, 0.0)}, {1000});
  for (const std::int64_t s : {0, 1, 500, 999})
    EXPECT_NEAR(schedule(1e-4, s), 1e-4 * (1e-6 + (1 - 1e-6) * static_cast<double>(s) / 1000.0), 1e-18);
  EXPECT_DOUBLE_EQ(schedule(1e-4, 1000), 1e-4);
  for (const std::int64_t s : {1001, 250'000, 1'000'000})
    EXPECT_NEAR(schedule(1e-4, s), 0.5e-4 * (1 + std::cos(kPi * static_cast<double>(s - 1000) / 1e6)), 1e-17);
}

TEST(LrSchedule, CosineComesBackUpAfterTMax) {
  const LrSchedule schedule = cosine_annealing_lr(50, 1e-5);
  EXPECT_NEAR(schedule(3e-4, 50), 1e-5, 1e-18);
  EXPECT_NEAR(schedule(3e-4, 75), schedule(3e-4, 25), 1e-16);
  EXPECT_NEAR(schedule(3e-4, 100), 3e-4, 1e-16);
}

TEST(LrSchedule, StepsDownAtMilestones) {
  const LrSchedule steps = multi_step_lr({10, 4}, 0.2);
  EXPECT_DOUBLE_EQ(steps(2.0, 3), 2.0);
  EXPECT_DOUBLE_EQ(steps(2.0, 4), 0.4);
  EXPECT_DOUBLE_EQ(steps(2.0, 10), 2.0 * 0.2 * 0.2);
}

TEST(LrSchedule, LinearConstantAndWarmUp) {
  EXPECT_DOUBLE_EQ(linear_lr(0.5, 1.0, 10)(2.0, 5), 1.5);
  EXPECT_DOUBLE_EQ(linear_lr(0.5, 0.25, 10)(2.0, 1000), 0.5);
  EXPECT_DOUBLE_EQ(constant_lr(0.1, 3)(2.0, 2), 0.2);
  EXPECT_DOUBLE_EQ(constant_lr(0.1, 3)(2.0, 3), 2.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)(7.0, 0), 1.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)(7.0, 6), 7.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)(7.0, 600), 7.0);
}

TEST(LrSchedule, SeveralMilestonesCountTheirOwnSteps) {
  const LrSchedule schedule = sequential_lr({constant_lr(0.5, 100), linear_lr(0.0, 1.0, 10), unscheduled()}, {3, 13});
  EXPECT_DOUBLE_EQ(schedule(1.0, 2), 0.5);
  EXPECT_DOUBLE_EQ(schedule(1.0, 3), 0.0);
  EXPECT_DOUBLE_EQ(schedule(1.0, 8), 0.5);
  EXPECT_DOUBLE_EQ(schedule(1.0, 13), 1.0);
  EXPECT_THROW(sequential_lr({unscheduled()}, {3}), InputError);
  EXPECT_THROW(sequential_lr({unscheduled(), unscheduled(), unscheduled()}, {5, 3}), InputError);
}

TEST(LrSchedule, ReadsJsonAndSharesOfMaxSteps) {
  const Json json = Json::parse(R"({"name": "SequentialLR", "schedulers": [
      {"name": "LinearLR", "args": {"start_factor": 0.1, "total_iters": "10%"}},
      {"name": "CosineAnnealingLR", "args": {"T_max": 90}}], "args": {"milestones": ["10%"]}})");
  const LrSchedule schedule = read_schedule(json, 100, "f", "/s");
  EXPECT_DOUBLE_EQ(schedule(1.0, 0), 0.1);
  EXPECT_DOUBLE_EQ(schedule(1.0, 10), 1.0);
  EXPECT_NEAR(schedule(1.0, 55), 0.5, 1e-12);
}

TEST(LrSchedule, BadJsonNamesThePlace) {
  const auto message = [](const char* text) {
    try {
      read_schedule(Json::parse(text), 100, "f.json", "/s");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message(R"({"name": "CosineAnnealingLR", "args": {"T_mx": 3}})").find("T_max"), std::string::npos);
  EXPECT_NE(message(R"({"name": "StepLR"})").find("LinearLR"), std::string::npos);
  EXPECT_NE(message(R"({"name": "LinearLR", "args": {"total_iters": "x%"}})").find("/s/args/total_iters"),
            std::string::npos);
  EXPECT_NE(message(R"({"name": "SequentialLR", "schedulers": [], "args": {"milestones": []}})").find("milestones"),
            std::string::npos);
}

}  // namespace

namespace {

TEST(Orthogonalize, BringsSingularValuesNearOne) {
  torch::manual_seed(0);
  for (const auto& shape : {std::vector<std::int64_t>{24, 64}, {64, 24}, {32, 32}}) {
    const torch::Tensor out = orthogonalize(torch::randn(shape));
    ASSERT_EQ(out.sizes(), torch::IntArrayRef(shape));
    const torch::Tensor values = std::get<1>(torch::linalg_svd(out.to(torch::kFloat64), false));
    // The quintic's plateau reaches from about 0.68 to 1.13 for values that began above 0.003 of the norm.
    EXPECT_LT(values.max().item<double>(), 1.25);
    if (shape[0] != shape[1]) {
      EXPECT_GT(values.min().item<double>(), 0.6);
    }
  }
}

struct TwoLayersImpl : torch::nn::Module {
  TwoLayersImpl() {
    hidden = register_module("hidden", torch::nn::Linear(32, 32));
    head = register_module("head", torch::nn::Linear(32, 3));
  }
  torch::nn::Linear hidden{nullptr}, head{nullptr};
};

TEST(Muon, TurnsMatricesAndLeavesTheRestToAdamW) {
  torch::manual_seed(1);
  const auto model = std::make_shared<TwoLayersImpl>(), twin = std::make_shared<TwoLayersImpl>();
  {
    torch::NoGradGuard no_grad;
    for (std::size_t i = 0; i < twin->parameters().size(); ++i) twin->parameters()[i].copy_(model->parameters()[i]);
  }
  ParameterBuffer buffer({{"model", model}}), reference({{"model", twin}});
  const torch::Tensor gradient = torch::randn_like(buffer.gradient());
  AdamW rest(buffer.master(), {}), alone(reference.master(), {});
  Muon muon(buffer, {});
  const torch::Tensor before = model->hidden->weight.detach().clone();
  buffer.gradient().copy_(gradient);
  muon.step(buffer, rest, 1.0, 0.01);
  alone.step(reference.master(), gradient, 1.0, 0.01);
  EXPECT_TRUE(torch::equal(model->head->weight, twin->head->weight));  // a side of 3: AdamW
  EXPECT_TRUE(torch::equal(model->hidden->bias, twin->hidden->bias));
  EXPECT_FALSE(torch::equal(model->hidden->weight, twin->hidden->weight));
  // Root mean square of the change: lr · 0.2 · sqrt(32) · sqrt(32 · σ² / 32²) = lr · 0.2 · σ, σ in the plateau.
  const double change = (model->hidden->weight - before * (1.0 - 0.01 * 0.01)).pow(2).mean().sqrt().item<double>();
  EXPECT_NEAR(change / (0.01 * 0.2), 0.9, 0.25);
}

TEST(Muon, RefusesAMomentumThatNeverForgets) {
  const auto model = std::make_shared<TwoLayersImpl>();
  const ParameterBuffer buffer({{"model", model}});
  Muon::Options options;
  options.momentum = 1.0;
  EXPECT_THROW(Muon(buffer, options), InputError);
}

}  // namespace

namespace {

/// The base rate, but for one step at which finite gradients make weights that are not finite.
LrSchedule burst(std::int64_t at) {
  return [at](double base, std::int64_t step) { return step == at ? std::numeric_limits<double>::infinity() : base; };
}

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
  options_.schedule = burst(13);
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
  options_.schedule = burst(0);
  ParameterUpdate update(buffer_, options_);
  const torch::Tensor start = buffer_.master().clone();
  EXPECT_TRUE(apply(update, 0).restored);
  EXPECT_TRUE(torch::equal(buffer_.master(), start));
}

TEST_F(RecoveryTest, IsAnErrorWhenThereIsNothingToGoBackTo) {
  options_.schedule = burst(3);
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
struct SmallStage : Stage, data::BatchSource {
  SmallStage() {
    torch::manual_seed(7);
    model = std::make_shared<torch::nn::LinearImpl>(2, 1);
  }
  std::shared_ptr<torch::nn::LinearImpl> model;
  std::vector<nn::NamedModel> models() const override { return {{"net", model}}; }
  const data::BatchSource& data() const override { return *this; }
  std::size_t size() const override { return 3; }
  std::unique_ptr<data::Batch> load(const std::vector<data::Draw>&) const override {
    auto batch = std::make_unique<data::Batch>();
    batch->ids.push_back("sample");
    return batch;
  }
  Losses losses(const data::Batch&, const LossContext& context) override {
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
    options.update.schedule = burst(17);
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
