#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/flow/matching.h"
#include "anigen/flow/sampler.h"

namespace anigen::flow {

namespace {

at::Generator generator(std::uint64_t seed) { return at::detail::createCPUGenerator(seed); }

double largest_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

Tensor normal(const std::vector<std::int64_t>& shape, std::uint64_t seed) {
  return torch::randn(shape, generator(seed), torch::kFloat64);
}

TEST(FlowMatching, PathRunsFromDataToNoise) {
  const Tensor data = normal({2, 3, 2, 2, 2}, 1), noise = normal({2, 3, 2, 2, 2}, 2);
  EXPECT_LT(largest_difference(noisy(data, noise, torch::zeros({2}), 0.0), data), 1e-15);
  EXPECT_LT(largest_difference(noisy(data, noise, torch::ones({2})), noise), 1e-15);
  // At t = 0 sigma_min of the noise is left.
  EXPECT_LT(largest_difference(noisy(data, noise, torch::zeros({2}), 0.25), data + 0.25 * noise), 1e-15);
}

TEST(FlowMatching, TargetIsTheDerivativeOfThePath) {
  const Tensor data = normal({2, 5}, 1), noise = normal({2, 5}, 2), t = torch::tensor({0.3, 0.8}, torch::kFloat64);
  const double h = 1e-6;
  const Tensor slope = (noisy(data, noise, t + h) - noisy(data, noise, t - h)) / (2.0 * h);
  EXPECT_LT(largest_difference(slope, velocity_target(data, noise)), 1e-8);  // the path is linear: rounding only
}

TEST(FlowMatching, VelocityGivesDataAndNoiseBack) {
  const Tensor data = normal({3, 4}, 3), noise = normal({3, 4}, 4);
  const Tensor t = torch::tensor({0.0, 0.4, 1.0}, torch::kFloat64);
  const Tensor x_t = noisy(data, noise, t, 0.1), v = velocity_target(data, noise, 0.1);
  EXPECT_LT(largest_difference(x0_from_velocity(x_t, v, t, 0.1), data), 1e-14);
  EXPECT_LT(largest_difference(noise_from_velocity(x_t, v, t), noise), 1e-14);
}

TEST(FlowMatching, TimesBelongToEntriesOfTheFirstAxis) {
  const Tensor x = torch::ones({2, 3, 4});
  EXPECT_THROW(noisy(x, x, torch::zeros({3})), c10::Error);
  EXPECT_THROW(noisy(x, x, torch::zeros({2, 1})), c10::Error);
}

TEST(TimeSchedule, LogitNormalHasItsMedianAndSpread) {
  TimeSchedule schedule;
  schedule.mean = 1.0;
  const Tensor t = schedule.sample(20000, generator(5));
  EXPECT_EQ(t.scalar_type(), torch::kFloat32);
  const Tensor logit = torch::log(t / (1.0 - t));
  // Standard errors of 20,000 draws: 0.007 of the mean, 0.005 of the deviation.
  EXPECT_NEAR(logit.mean().item<double>(), 1.0, 0.04);
  EXPECT_NEAR(logit.std().item<double>(), 1.0, 0.03);
}

TEST(TimeSchedule, QuantilesCutDrawsIntoEqualParts) {
  constexpr std::int64_t kDraws = 200'000, kParts = 5;
  const Tensor probabilities = (torch::arange(kParts).to(torch::kFloat32) + 0.5) / static_cast<double>(kParts);
  for (const char* config : {R"({"name": "uniform"})", R"({"name": "logitNormal", "args": {"mean": 4, "std": 1.5}})"}) {
    const TimeSchedule schedule = TimeSchedule::from_json(Json::parse(config));
    const Tensor draws = schedule.sample(kDraws, generator(3));
    const Tensor times = schedule.quantiles(probabilities);
    // The share of 200,000 draws below a quantile spreads by .0011.
    for (std::int64_t k = 0; k < kParts; ++k)
      EXPECT_NEAR((draws < times[k]).to(torch::kFloat64).mean().item<double>(), probabilities[k].item<double>(), 0.005);
  }
}

TEST(FlowStageOptions, EvaluatesEvenlyOrWhereTrainingLooks) {
  FlowStageOptions options;
  options.t_schedule.mean = 4.0;
  EXPECT_TRUE(torch::allclose(options.eval_grid(), torch::tensor({0.125, 0.375, 0.625, 0.875}, torch::kFloat32)));
  options.eval_on_schedule = true;
  EXPECT_TRUE(torch::equal(options.eval_grid(),
                           options.t_schedule.quantiles(torch::tensor({0.125, 0.375, 0.625, 0.875}, torch::kFloat32))));
}

TEST(TimeSchedule, DrawsDependOnTheGeneratorAlone) {
  const TimeSchedule schedule = TimeSchedule::from_json(Json::parse(R"({"name": "uniform"})"));
  torch::manual_seed(1);
  const Tensor first = schedule.sample(9, generator(7));
  torch::manual_seed(2);
  EXPECT_TRUE(torch::equal(first, schedule.sample(9, generator(7))));
  EXPECT_FALSE(torch::equal(first, schedule.sample(9, generator(8))));
}

TEST(TimeSchedule, ReadsAndWritesItsConfig) {
  const Json json = Json::parse(R"({"name": "logitNormal", "args": {"mean": 1.0, "std": 2.0}})");
  EXPECT_EQ(TimeSchedule::from_json(json).to_json(), json);
  EXPECT_EQ(TimeSchedule::from_json(Json::object()).mean, 0.0);
  for (const char* bad : {R"({"name": "cosine"})", R"({"name": "uniform", "args": {"mean": 0}})",
                          R"({"args": {"std": 0}})", R"({"argz": {}})"}) {
    EXPECT_THROW(TimeSchedule::from_json(Json::parse(bad)), InputError) << bad;
  }
}

TEST(ConditionDropout, DropsTheAskedShareAndReplacesByZeros) {
  const Tensor dropped = draw_condition_dropout(10000, 0.1, generator(3));
  EXPECT_NEAR(dropped.to(torch::kFloat64).mean().item<double>(), 0.1, 0.012);  // four standard errors
  EXPECT_FALSE(draw_condition_dropout(1000, 0.0, generator(3)).any().item<bool>());
  EXPECT_TRUE(draw_condition_dropout(1000, 1.0, generator(3)).all().item<bool>());

  const Tensor condition = torch::ones({3, 2, 2}), mask = torch::tensor({false, true, false});
  const Tensor kept = replace_condition(condition, mask);
  EXPECT_EQ(kept[1].abs().sum().item<double>(), 0.0);
  EXPECT_EQ(kept.sum().item<double>(), 8.0);
  EXPECT_EQ(replace_condition(condition, mask, 5.0 * condition)[1].sum().item<double>(), 20.0);
}

TEST(TimeBins, HoldTheirLowerEnds) {
  const Tensor t = torch::tensor({0.0, 0.0999, 0.1, 0.55, 0.9999}, torch::kFloat64);
  EXPECT_TRUE(torch::equal(time_bin(t), torch::tensor({0, 0, 1, 5, 9}, torch::kInt64)));
  const Tensor means = mean_per_time_bin(torch::tensor({1.0, 3.0, 7.0, 5.0, 2.0}), t);
  EXPECT_EQ(means[0].item<double>(), 2.0);
  EXPECT_EQ(means[1].item<double>(), 7.0);
  EXPECT_TRUE(std::isnan(means[2].item<double>()));
  EXPECT_EQ(means[9].item<double>(), 2.0);
}

TEST(TimeBins, ErrorPerItemIsItsMean) {
  const Tensor a = torch::tensor({1.0, 3.0, 0.0, 0.0}).view({2, 2}), b = torch::zeros({2, 2});
  EXPECT_TRUE(torch::equal(mse_per_item(a, b), torch::tensor({5.0f, 0.0f})));
}

}  // namespace

namespace {

TEST(TimeBins, ItemsOfVoxelsHaveMeansOfTheirOwn) {
  const Tensor rows = torch::tensor({{1.0, 3.0}, {5.0, 7.0}, {10.0, 20.0}});
  const Tensor item = torch::tensor({0, 0, 2}, torch::kInt64);
  const Tensor means = mean_per_item(rows, item, 4);
  EXPECT_TRUE(torch::equal(means, torch::tensor({4.0, 0.0, 15.0, 0.0})))
      << means << "over rows and channels; nothing for items without rows";
}

}  // namespace

}  // namespace anigen::flow
