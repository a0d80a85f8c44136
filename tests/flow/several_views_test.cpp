#include "anigen/flow/several_views.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/nn/condition_cache.h"

namespace anigen::flow {
namespace {

SamplerOptions views_sampler(std::int64_t steps, double strength = 0.5) {
  SamplerOptions options;
  options.steps = steps;
  options.cfg_strength = strength;
  return options;
}

// A flow whose velocity depends on its condition, state and time, nonlinearly.
Velocities conditioned(const Tensor& condition, bool guided = true) {
  const auto under = [](const Tensor& tokens) {
    return [pull = tokens.mean()](const Streams& x, float time) {
      return Streams{(x[0] + pull).sin() * (1.0 + time / 1000.0), x[1] * pull};
    };
  };
  Velocities velocities;
  velocities.conditional = under(condition);
  if (guided) velocities.unconditional = under(torch::zeros_like(condition));
  return velocities;
}

Velocities guided_flow(const Tensor& condition) { return conditioned(condition); }

struct ViewsOfOne : ::testing::Test {
  Tensor one = torch::tensor({0.3, 0.9, -0.1}, torch::kFloat64).view({1, 3, 1});
  Tensor other = torch::tensor({1.5, -0.2, 0.4}, torch::kFloat64).view({1, 3, 1});
  Streams noise{torch::linspace(-1, 1, 12, torch::kFloat64).view({3, 4}), torch::ones({5}, torch::kFloat64)};

  Streams sampled(const Tensor& views, ViewRule rule, const SamplerOptions& options) const {
    return sample_flow(noise, under_views(views, rule, options, guided_flow), options).samples;
  }
};

TEST_F(ViewsOfOne, OneViewGivesTheVeryNumbersOfBefore) {
  const SamplerOptions options = views_sampler(6);
  const Streams before = sample_flow(noise, conditioned(one), options).samples;
  for (const ViewRule rule : {ViewRule::kAverage, ViewRule::kStochastic}) {
    const Streams now = sampled(one, rule, options);
    for (std::size_t i = 0; i < before.size(); ++i) EXPECT_TRUE(now[i].equal(before[i]));
  }
}

TEST_F(ViewsOfOne, EqualViewsGiveThoseOfOneUpToRounding) {
  for (const Solver solver : {Solver::kEuler, Solver::kMidpoint, Solver::kHeun}) {
    SamplerOptions options = views_sampler(6);
    options.solver = solver;
    const Streams single = sampled(one, ViewRule::kAverage, options);
    for (const ViewRule rule : {ViewRule::kAverage, ViewRule::kStochastic}) {
      const Streams three = sampled(torch::cat({one, one, one}), rule, options);
      for (std::size_t i = 0; i < single.size(); ++i) EXPECT_TRUE(torch::allclose(three[i], single[i], 0.0, 1e-13));
    }
  }
}

// One guided step by hand: x − ((1 + s) (v₁ + v₂) / 2 − s v₀).
TEST_F(ViewsOfOne, TheMeanOfTheVelocitiesIsGuided) {
  const SamplerOptions options = views_sampler(1, 0.5);
  const Streams first = conditioned(one).conditional(noise, 1000.0F),
                second = conditioned(other).conditional(noise, 1000.0F);
  const Streams none = conditioned(one).unconditional(noise, 1000.0F);
  const Streams both = sampled(torch::cat({one, other}), ViewRule::kAverage, options);
  for (std::size_t i = 0; i < both.size(); ++i) {
    const Tensor expected = noise[i] - (1.5 * (first[i] + second[i]) / 2.0 - 0.5 * none[i]);
    EXPECT_TRUE(torch::allclose(both[i], expected, 0.0, 1e-14));
  }
}

TEST_F(ViewsOfOne, TheNegativeIsAskedOncePerStep) {
  int positive = 0, negative = 0;
  const auto counted = [&](const Tensor&) {
    Velocities velocities;
    velocities.conditional = [&](const Streams& x, float) { return ++positive, x; };
    velocities.unconditional = [&](const Streams& x, float) { return ++negative, x; };
    return velocities;
  };
  const SamplerOptions options = views_sampler(5);
  const Tensor views = torch::cat({one, other, one});
  sample_flow(noise, under_views(views, ViewRule::kAverage, options, counted), options);
  EXPECT_EQ(positive, 15);
  EXPECT_EQ(negative, 5);
  positive = negative = 0;
  sample_flow(noise, under_views(views, ViewRule::kStochastic, options, counted), options);
  EXPECT_EQ(positive, 5);
  EXPECT_EQ(negative, 5);
}

// Both velocities of a step of Heun's are of one view, although the second is asked at the time of the next step.
TEST_F(ViewsOfOne, StochasticShowsTheViewsInTurn) {
  std::vector<double> asked;
  const auto recorded = [&](const Tensor& condition) {
    Velocities velocities;
    velocities.conditional = [&asked, first = condition.flatten()[0].item<double>()](const Streams& x, float) {
      return asked.push_back(first), x;
    };
    return velocities;
  };
  SamplerOptions options = views_sampler(3);
  options.solver = Solver::kHeun;
  sample_flow(noise, under_views(torch::cat({one, other}), ViewRule::kStochastic, options, recorded), options);
  EXPECT_EQ(asked, (std::vector<double>{0.3, 0.3, 1.5, 1.5, 0.3}));
}

TEST_F(ViewsOfOne, ConditionsOfAllViewsStayInTheCache) {
  int made = 0;
  const auto cached = [&](const Tensor& condition) {
    const auto under = [&](const Tensor& tokens) {
      return [&made, tokens](const Streams& x, float) {
        nn::context_of(&made, tokens, [&] { return ++made, tokens * 2.0; });
        return x;
      };
    };
    Velocities velocities;
    velocities.conditional = under(condition);
    velocities.unconditional = under(torch::zeros_like(condition));
    return velocities;
  };
  const SamplerOptions options = views_sampler(8);
  sample_flow(noise, under_views(torch::cat({one, other, one, other}), ViewRule::kAverage, options, cached), options);
  EXPECT_EQ(made, 5) << "four views and the negative, once each";
}

TEST_F(ViewsOfOne, NoViewAndViewsWithoutATurnAreErrors) {
  EXPECT_THROW(under_views(torch::zeros({0, 3, 1}), ViewRule::kAverage, views_sampler(4), guided_flow), InputError);
  const Tensor four = torch::cat({one, other, one, other});
  EXPECT_THROW(under_views(four, ViewRule::kStochastic, views_sampler(3), guided_flow), InputError);
  EXPECT_NO_THROW(under_views(four, ViewRule::kStochastic, views_sampler(4), guided_flow));
  EXPECT_NO_THROW(under_views(four, ViewRule::kAverage, views_sampler(1), guided_flow));
  EXPECT_THROW(parse_view_rule("mean"), InputError);
}

}  // namespace
}  // namespace anigen::flow
