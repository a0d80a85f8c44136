#include "anigen/flow/sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/attention_windows.h"

namespace anigen::flow {
namespace {

SamplerOptions with_steps(std::int64_t steps) {
  SamplerOptions options;
  options.steps = steps;
  return options;
}

double value(const Tensor& tensor) { return tensor.item<double>(); }

TEST(TimeGrid, GoldenNumbers) {
  SamplerOptions options = with_steps(5);
  options.rescale_t = 3.0;
  const std::vector<double> golden = {1.0, 0.9230769, 0.8181818, 0.6666667, 0.4285714, 0.0};
  const std::vector<double> times = time_grid(options);
  ASSERT_EQ(times.size(), golden.size());
  for (std::size_t i = 0; i < golden.size(); ++i) EXPECT_NEAR(times[i], golden[i], 5e-8);
}

TEST(FlowSampler, ConstantVelocityIsIntegratedExactly) {
  const Tensor noise = torch::tensor({2.0, -1.0}, torch::kFloat64), target = torch::tensor({0.5, 3.0}, torch::kFloat64);
  const Velocities flow = {[&](const Streams&, float) { return Streams{noise - target}; }};
  for (const std::int64_t steps : {1, 7, 50}) {
    const Sampled result = sample_flow({noise}, flow, with_steps(steps));
    EXPECT_LT(value((result.samples[0] - target).abs().max()), 1e-13) << steps;
  }
}

TEST(FlowSampler, LinearFieldConvergesToTheExponential) {
  // dx/dt = x from t = 1 to 0 shrinks x by e; Euler's n steps give (1 − 1/n)^n.
  const Tensor noise = torch::ones({1}, torch::kFloat64);
  const Velocities flow = {[](const Streams& x, float) { return x; }};
  for (const std::int64_t steps : {10, 100}) {
    const double n = static_cast<double>(steps);
    const Sampled result = sample_flow({noise}, flow, with_steps(steps));
    EXPECT_NEAR(value(result.samples[0]), std::pow(1.0 - 1.0 / n, n), 1e-13);
    EXPECT_NEAR(value(result.samples[0]), std::exp(-1.0), 0.2 / n);  // first order: error e⁻¹/(2n)
  }
}

TEST(FlowSampler, MidpointAndHeunAreOfSecondOrder) {
  // dx/dt = x: a step of h multiplies by 1 − h + h²/2 in both; Heun's last step is Euler's.
  const Tensor noise = torch::ones({1}, torch::kFloat64);
  for (const Solver solver : {Solver::kMidpoint, Solver::kHeun}) {
    std::vector<double> errors;
    for (const std::int64_t steps : {10, 20}) {
      int passes = 0;
      const Velocities flow = {[&](const Streams& x, float) { return ++passes, x; }};
      SamplerOptions options = with_steps(steps);
      options.solver = solver;
      const double n = static_cast<double>(steps), h = 1.0 / n, factor = 1.0 - h + 0.5 * h * h;
      const double expected = solver == Solver::kHeun ? std::pow(factor, n - 1.0) * (1.0 - h) : std::pow(factor, n);
      const double sampled = value(sample_flow({noise}, flow, options).samples[0]);
      EXPECT_NEAR(sampled, expected, 1e-13);
      EXPECT_EQ(passes, solver == Solver::kHeun ? 2 * steps - 1 : 2 * steps);
      errors.push_back(std::abs(sampled - std::exp(-1.0)));
    }
    EXPECT_GT(errors[0] / errors[1], 3.5);
  }
}

TEST(FlowSampler, MidpointAsksHalfWayAndGuidesByThatTime) {
  std::vector<float> asked, guided;
  const Velocities flow = {[&](const Streams& x, float time) { return asked.push_back(time), x; },
                           [&](const Streams& x, float time) { return guided.push_back(time), x; }};
  SamplerOptions options = with_steps(2);  // t = 1, 0.75, 0.5, 0.25
  options.solver = Solver::kMidpoint;
  options.cfg_interval = std::make_pair(0.5, 0.8);
  sample_flow({torch::ones({2})}, flow, options);
  EXPECT_EQ(asked, (std::vector<float>{1000.0f, 750.0f, 500.0f, 250.0f}));
  EXPECT_EQ(guided, (std::vector<float>{750.0f, 500.0f}));
}

TEST(FlowSampler, AdamsIsOfSecondOrderWithOnePassPerStep) {
  const Tensor noise = torch::ones({1}, torch::kFloat64);
  for (const double rescale : {1.0, 3.0}) {  // equal steps, and steps that change
    std::vector<double> errors;
    for (const std::int64_t steps : {20, 40}) {
      const Velocities flow = {[&](const Streams& x, float) { return x; }};
      SamplerOptions options = with_steps(steps);
      options.solver = Solver::kAdams;
      options.rescale_t = rescale;
      const Sampled sampled = sample_flow({noise}, flow, options);
      EXPECT_EQ(sampled.passes, steps);
      errors.push_back(std::abs(value(sampled.samples[0]) - std::exp(-1.0)));
    }
    EXPECT_GT(errors[0] / errors[1], 3.5);
  }
}

TEST(FlowSampler, AdamsFollowsAVelocityLinearInTimeExactlyAfterItsFirstStep) {
  // dx/dt = t: Euler's first step of h leaves h²/2, all others nothing.
  const Velocities flow = {
      [](const Streams& x, float time) { return Streams{torch::full_like(x[0], static_cast<double>(time) / 1000.0)}; }};
  SamplerOptions options = with_steps(4);
  options.solver = Solver::kAdams;
  const double end = value(sample_flow({torch::ones({1}, torch::kFloat64)}, flow, options).samples[0]);
  EXPECT_NEAR(end, 0.5 - 0.5 * 0.25 * 0.25, 1e-6);
}

TEST(FlowSampler, KeepsTheGuidanceOfEveryFewSteps) {
  std::vector<float> asked;
  const auto difference = [](float time) { return 1.0 + static_cast<double>(time) / 1000.0; };
  const Velocities flow = {
      [&](const Streams& x, float time) { return Streams{torch::full_like(x[0], difference(time))}; },
      [&](const Streams& x, float time) { return asked.push_back(time), Streams{torch::zeros_like(x[0])}; }};
  SamplerOptions options = with_steps(5);
  options.cfg_strength = 2.0;
  options.cfg_every = 2;
  const Sampled sampled = sample_flow({torch::zeros({1}, torch::kFloat64)}, flow, options);
  EXPECT_EQ(asked, (std::vector<float>{1000.0F, 600.0F, 200.0F}));
  EXPECT_EQ(sampled.passes, 8);
  double expected = 0.0;  // v + s d of the last difference
  for (const auto& [t, of] : {std::pair(1.0, 1.0), {0.8, 1.0}, {0.6, 0.6}, {0.4, 0.6}, {0.2, 0.2}})
    expected -= 0.2 * ((1.0 + t) + 2.0 * (1.0 + of));
  EXPECT_NEAR(value(sampled.samples[0]), expected, 1e-6);
}

TEST(FlowSampler, PredictsVelocitiesWithinATolerance) {
  // A velocity linear in time is predicted exactly: every second step from the third one on, but not the last.
  int passes = 0;
  const Velocities linear = {[&](const Streams& x, float time) {
    return ++passes, Streams{torch::full_like(x[0], static_cast<double>(time) / 1000.0)};
  }};
  SamplerOptions options = with_steps(10);
  const Tensor noise = torch::ones({2}, torch::kFloat64);
  const Tensor every = sample_flow({noise}, linear, options).samples[0];
  passes = 0;
  options.velocity_tolerance = 1e-4;
  const Sampled spared = sample_flow({noise}, linear, options);
  EXPECT_TRUE(torch::allclose(spared.samples[0], every, 1e-5, 1e-6));
  EXPECT_EQ(spared.passes, passes);
  EXPECT_EQ(passes, 7);  // the error is known after the third: 0 1 2 · 4 · 6 · 8 9

  // One that jumps is asked for at every step.
  const Velocities jumps = {[&](const Streams& x, float time) {
    return Streams{torch::full_like(x[0], std::sin(static_cast<double>(time)))};
  }};
  EXPECT_EQ(sample_flow({noise}, jumps, options).passes, 10);
}

TEST(FlowSampler, FirstStepsAttendInsideWindows) {
  std::vector<std::int64_t> windows;
  const Velocities flow = {[&](const Streams& x, float) {
    windows.push_back(nn::AttentionWindows::size());
    return Streams{torch::ones_like(x[0])};
  }};
  SamplerOptions options = with_steps(4);
  options.solver = Solver::kMidpoint;  // two velocities per step
  options.windowed_steps = 2;
  options.window = 6;
  sample_flow({torch::ones({1})}, flow, options);
  EXPECT_EQ(windows, (std::vector<std::int64_t>{6, 6, 6, 6, 0, 0, 0, 0}));
  EXPECT_EQ(nn::AttentionWindows::size(), 0);
}

// Kept differences and predictions are those of windows: the first step without them asks anew.
TEST(FlowSampler, StepsBehindTheWindowsAskAnew) {
  std::vector<float> asked;
  const Velocities flow = {
      [](const Streams& x, float) { return Streams{torch::ones_like(x[0])}; },
      [&](const Streams& x, float time) { return asked.push_back(time), Streams{torch::zeros_like(x[0])}; }};
  SamplerOptions options = with_steps(5);
  options.cfg_every = 4;
  options.windowed_steps = 2;
  sample_flow({torch::zeros({1})}, flow, options);
  EXPECT_EQ(asked, (std::vector<float>{1000.0F, 600.0F}));
  options.cfg_every = 1;
  options.velocity_tolerance = 0.1;
  options.windowed_steps = 3;
  EXPECT_EQ(sample_flow({torch::zeros({1})}, flow, options).passes, 10);  // predicted at no step: 3 windowed, 2 after
}

TEST(FlowSampler, GuidanceGoldenNumbers) {
  const auto model = [](const Streams& x, float time, double condition, double k) {
    const double t = static_cast<double>(time) / 1000.0;
    return Streams{0.5 * x[0] + (condition * k + t), 0.25 * x[1] - condition * k};
  };
  const Velocities flow = {[&](const Streams& x, float time) { return model(x, time, 1.0, 2.0); },
                           [&](const Streams& x, float time) { return model(x, time, 0.0, 0.0); }};
  SamplerOptions options = with_steps(4);
  options.cfg_strength = 2.0;
  const Sampled result = sample_flow({torch::tensor({1.0f, 2.0f}), torch::tensor({3.0f})}, flow, options);
  EXPECT_NEAR(value(result.samples[0][0]), -4.8625488, 2e-6);
  EXPECT_NEAR(value(result.samples[0][1]), -4.2763672, 2e-6);
  EXPECT_NEAR(value(result.samples[1][0]), 7.7780000, 2e-6);
}

TEST(FlowSampler, BothPassesRunAtStrengthZero) {
  int conditional = 0, unconditional = 0;
  const Velocities flow = {[&](const Streams& x, float) { return ++conditional, x; },
                           [&](const Streams& x, float) { return ++unconditional, x; }};
  SamplerOptions options = with_steps(3);
  options.cfg_strength = 0.0;
  sample_flow({torch::ones({2})}, flow, options);
  EXPECT_EQ(conditional, 3);
  EXPECT_EQ(unconditional, 3);
}

TEST(FlowSampler, GuidesInsideTheIntervalOnly) {
  std::vector<float> guided;
  const Velocities flow = {[](const Streams& x, float) { return x; },
                           [&](const Streams& x, float time) { return guided.push_back(time), x; }};
  SamplerOptions options = with_steps(4);  // t = 1, 0.75, 0.5, 0.25
  options.cfg_interval = std::make_pair(0.25, 0.75);
  sample_flow({torch::ones({2})}, flow, options);
  EXPECT_EQ(guided, (std::vector<float>{750.0f, 500.0f, 250.0f}));  // both ends belong to it
}

TEST(FlowSampler, NoEarlierVelocityOutlivesAChangeOfGuidance) {
  // v = 1 and v_neg = 0: inside the interval 1 + s, outside 1, and every solver is exact.
  const Velocities flow = {[](const Streams& x, float) { return Streams{torch::ones_like(x[0])}; },
                           [](const Streams& x, float) { return Streams{torch::zeros_like(x[0])}; }};
  for (const bool predicts : {false, true}) {
    SamplerOptions options = with_steps(8);
    options.cfg_strength = 7.5;
    options.cfg_interval = std::make_pair(0.5, 1.0);  // t = 1, 0.875, 0.75, 0.625, 0.5 of eight steps
    if (predicts) {
      options.velocity_tolerance = 0.1;
    } else {
      options.solver = Solver::kAdams;
    }
    const Sampled sampled = sample_flow({torch::zeros({1}, torch::kFloat64)}, flow, options);
    EXPECT_NEAR(value(sampled.samples[0]), -(5.0 * 8.5 + 3.0) / 8.0, 1e-9) << predicts;
    EXPECT_EQ(sampled.passes < 8 + 5, predicts);
  }
}

TEST(FlowSampler, TrajectoryAndProgressWhenAskedFor) {
  const Tensor noise = torch::tensor({2.0}, torch::kFloat64), data = torch::tensor({-1.0}, torch::kFloat64);
  const Velocities flow = {[&](const Streams&, float) { return Streams{velocity_target(data, noise)}; }};
  SamplingExtras extras;
  extras.trajectory = true;
  std::vector<std::int64_t> steps;
  extras.progress = [&](std::int64_t step, std::int64_t count) {
    EXPECT_EQ(count, 4);
    steps.push_back(step);
  };
  const Sampled result = sample_flow({noise}, flow, with_steps(4), extras);
  EXPECT_EQ(steps, (std::vector<std::int64_t>{1, 2, 3, 4}));
  ASSERT_EQ(result.x_t.size(), 4u);
  ASSERT_EQ(result.x_0.size(), 4u);
  EXPECT_NEAR(value(result.x_0[0][0]), -1.0, 1e-12);
  EXPECT_TRUE(torch::equal(result.x_t[3][0], result.samples[0]));
  EXPECT_TRUE(sample_flow({noise}, flow, with_steps(2)).x_t.empty());

  extras.progress = [](std::int64_t, std::int64_t) { throw std::runtime_error("enough"); };
  EXPECT_THROW(sample_flow({noise}, flow, with_steps(4), extras), std::runtime_error);
}

TEST(FlowSampler, InpaintingKeepsWhatIsKnown) {
  const Tensor noise = torch::tensor({2.0, 2.0}, torch::kFloat64);
  const Tensor known = torch::tensor({5.0, 7.0}, torch::kFloat64), mask = torch::tensor({1.0, 0.0}, torch::kFloat64);
  const Inpainting inpainting = {{known}, {noise}, {mask}};
  SamplingExtras extras;
  extras.inpainting = &inpainting;
  SamplerOptions options = with_steps(5);
  options.sigma_min = 0.0;
  const Velocities flow = {[&](const Streams& x, float) { return Streams{torch::ones_like(x[0])}; }};
  const Sampled result = sample_flow({noise}, flow, options, extras);
  EXPECT_NEAR(value(result.samples[0][0]), 5.0, 1e-12);
  EXPECT_NEAR(value(result.samples[0][1]), 1.0, 1e-12);
}

TEST(FlowSampler, RecordsNoGradient) {
  const Tensor weight = torch::ones({1}, torch::requires_grad());
  const Velocities flow = {[&](const Streams& x, float) { return Streams{x[0] * weight}; }};
  EXPECT_FALSE(sample_flow({torch::ones({1})}, flow, with_steps(2)).samples[0].requires_grad());
}

TEST(FlowSampler, RefusesVelocitiesOfAnotherShape) {
  const Velocities flow = {[](const Streams& x, float) { return Streams{x[0], x[0]}; }};
  EXPECT_THROW(sample_flow({torch::ones({1})}, flow, with_steps(2)), c10::Error);
}

TEST(SamplerOptions, ReadsItsConfigAndRefusesNonsense) {
  const Json json = Json::parse(
      R"({"steps": 25, "rescale_t": 2.0, "cfg_strength": 7.5, "cfg_interval": [0.5, 1.0], "sigma_min": 1e-5,
          "cfg_every": 2, "velocity_tolerance": 0.1, "windowed_steps": 3, "window": 4})");
  EXPECT_EQ(SamplerOptions::from_json(json).to_json(), json);
  EXPECT_EQ(SamplerOptions::from_json(Json::parse(R"({"solver": "heun"})")).solver, Solver::kHeun);
  for (const char* bad :
       {R"({"steps": 0})", R"({"rescale_t": 0})", R"({"cfg_interval": [1, 0]})", R"({"cfg_interval": [0.5]})",
        R"({"sigma_min": 1})", R"({"cfg_scale": 1})", R"({"solver": "rk4"})", R"({"cfg_every": 0})",
        R"({"velocity_tolerance": -0.1})", R"({"windowed_steps": -1})", R"({"window": 0})"}) {
    EXPECT_THROW(SamplerOptions::from_json(Json::parse(bad)), InputError) << bad;
  }
}

}  // namespace
}  // namespace anigen::flow
