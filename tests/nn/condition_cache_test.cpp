#include "anigen/nn/condition_cache.h"

#include <gtest/gtest.h>

#include "anigen/nn/attention.h"

namespace anigen::nn {
namespace {

TEST(ConditionCache, KnowsAConditionAgainWhileItLives) {
  const Tensor first = torch::zeros({2}), second = torch::zeros({2}), third = torch::zeros({2});
  const int model = 0, other = 0;
  int made = 0;
  const auto ask = [&](const int& who, const Tensor& condition) {
    context_of(&who, condition, [&] { return ++made, condition + 1.0; });
    return made;
  };
  const torch::NoGradGuard no_grad;
  EXPECT_EQ(ask(model, first), 1);
  EXPECT_EQ(ask(model, first), 2);  // nobody keeps anything
  {
    const ConditionCache keep;
    EXPECT_EQ(ask(model, first), 3);
    EXPECT_EQ(ask(model, second), 4);
    EXPECT_EQ(ask(model, first), 4);
    EXPECT_EQ(ask(other, first), 5);
    EXPECT_EQ(ask(model, third), 6);  // the first goes
    EXPECT_EQ(ask(model, second), 6);
    EXPECT_EQ(ask(model, first), 7);
    {
      const ConditionCache inner;
      EXPECT_EQ(ask(model, first), 8);
    }
    EXPECT_EQ(ask(model, first), 8);
    const torch::AutoGradMode with_gradients(true);
    EXPECT_EQ(ask(model, first), 9);
  }
  EXPECT_EQ(ask(model, first), 10);
}

TEST(ConditionCache, ProjectionsOfContextsOnly) {
  const Tensor condition = torch::zeros({2}), features = torch::zeros({2});
  const int model = 0, attention = 0;
  int made = 0;
  const auto project = [&](const Tensor& context) {
    projected_context(&attention, context, [&] { return ++made, std::vector<Tensor>{context * 2.0}; });
    return made;
  };
  const torch::NoGradGuard no_grad;
  const ConditionCache keep;
  const Tensor context = context_of(&model, condition, [&] { return condition + 1.0; });
  EXPECT_EQ(project(context), 1);
  EXPECT_EQ(project(context), 1);
  EXPECT_EQ(project(features), 2);
  EXPECT_EQ(project(features), 3);  // no context: made anew
}

TEST(ConditionCache, CrossAttentionGivesTheSameBits) {
  torch::manual_seed(3);
  AttentionOptions options;
  options.channels = 16;
  options.num_heads = 2;
  options.context_channels = 8;
  options.qk_rms_norm = true;
  DenseAttention attention(options);
  const torch::NoGradGuard no_grad;
  for (Tensor& parameter : attention->parameters()) parameter.normal_(0.0, 0.5);  // layers come without numbers
  const Tensor context = torch::randn({2, 5, 8}), negative = torch::zeros_like(context);
  const Tensor x = torch::randn({2, 7, 16}), y = torch::randn({2, 7, 16});
  const Tensor plain_x = attention->forward(x, context), plain_y = attention->forward(y, negative);
  const ConditionCache keep;
  for (int step = 0; step < 2; ++step) {
    const Tensor own = context_of(&options, context, [&] { return context.clone(); });
    const Tensor own_negative = context_of(&options, negative, [&] { return negative.clone(); });
    EXPECT_TRUE(torch::equal(attention->forward(x, own), plain_x));
    EXPECT_TRUE(torch::equal(attention->forward(y, own_negative), plain_y));
  }
}

}  // namespace
}  // namespace anigen::nn
