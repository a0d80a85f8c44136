#include "anigen/train/optimizer.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/train/ema.h"
#include "anigen/train/parameter_update.h"
#include "tests/support/kernel_forms.h"

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
}  // namespace anigen::train
