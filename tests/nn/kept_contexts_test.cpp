#include "anigen/nn/kept_contexts.h"

#include <gtest/gtest.h>

#include "anigen/nn/dense_attention.h"

namespace anigen::nn {
namespace {

TEST(KeptContexts, KnowsATensorAgainWhileItLives) {
  const Tensor first = torch::zeros({2}), second = torch::zeros({2}), third = torch::zeros({2});
  const int owner = 0, other = 0;
  int made = 0;
  const auto ask = [&](const int& who, const Tensor& context) {
    kept(&who, context, [&]() -> std::vector<Tensor> { return ++made, std::vector<Tensor>{context + 1.0}; });
    return made;
  };
  const torch::NoGradGuard no_grad;
  EXPECT_EQ(ask(owner, first), 1);
  EXPECT_EQ(ask(owner, first), 2);  // nobody keeps anything
  {
    const KeptContexts keep;
    EXPECT_EQ(ask(owner, first), 3);
    EXPECT_EQ(ask(owner, second), 4);
    EXPECT_EQ(ask(owner, first), 4);
    EXPECT_EQ(ask(other, first), 5);
    EXPECT_EQ(ask(owner, third), 6);  // the first goes
    EXPECT_EQ(ask(owner, second), 6);
    EXPECT_EQ(ask(owner, first), 7);
    {
      const KeptContexts inner;
      EXPECT_EQ(ask(owner, first), 8);
    }
    EXPECT_EQ(ask(owner, first), 8);
    const torch::AutoGradMode with_gradients(true);
    EXPECT_EQ(ask(owner, first), 9);
  }
  EXPECT_EQ(ask(owner, first), 10);
}

TEST(KeptContexts, CrossAttentionGivesTheSameBits) {
  torch::manual_seed(3);
  DenseAttentionOptions options;
  options.channels = 16;
  options.num_heads = 2;
  options.context_channels = 8;
  options.qk_rms_norm = true;
  DenseAttention attention(options);
  const torch::NoGradGuard no_grad;
  const Tensor context = torch::randn({2, 5, 8}), negative = torch::zeros_like(context);
  const Tensor x = torch::randn({2, 7, 16}), y = torch::randn({2, 7, 16});
  const Tensor plain_x = attention->forward(x, context), plain_y = attention->forward(y, negative);
  const KeptContexts keep;
  for (int step = 0; step < 2; ++step) {
    EXPECT_TRUE(torch::equal(attention->forward(x, context), plain_x));
    EXPECT_TRUE(torch::equal(attention->forward(y, negative), plain_y));
  }
}

}  // namespace
}  // namespace anigen::nn
