#include "anigen/nn/trainable.h"

#include <gtest/gtest.h>

namespace anigen::nn {
namespace {

using torch::Tensor;

/// x² w, and how often it ran.
struct CountedPart {
  Tensor weight;
  int calls = 0;

  Tensor run(const Tensor& x) {
    return recomputed({x}, [this](const std::vector<Tensor>& inputs) {
      ++calls;
      return inputs[0] * inputs[0] * weight;
    });
  }
};

Tensor numbers(bool trained) { return torch::arange(1, 4, torch::kFloat64).set_requires_grad(trained); }

TEST(Recompute, AFrozenPartOfFixedInputsRunsOnceAndIsNoGraph) {
  CountedPart part{numbers(false)};
  const Tensor y = part.run(numbers(false));
  EXPECT_FALSE(y.requires_grad());
  EXPECT_EQ(part.calls, 1);
  EXPECT_TRUE(torch::equal(y, torch::tensor({1, 8, 27}).to(torch::kFloat64)));
}

TEST(Recompute, GradientsAreThoseOfThePlainPart) {
  for (const bool input_trained : {false, true}) {
    for (const bool weight_trained : {false, true}) {
      if (!input_trained && !weight_trained) continue;
      CountedPart part{numbers(weight_trained)};
      const Tensor x = numbers(input_trained);
      const Tensor y = part.run(x);
      EXPECT_TRUE(y.requires_grad());
      EXPECT_EQ(part.calls, 1);
      (3.0 * y).sum().backward();
      EXPECT_EQ(part.calls, 2) << "nothing was kept of the first time";
      const Tensor n = numbers(false);
      EXPECT_EQ(x.grad().defined(), input_trained);
      EXPECT_EQ(part.weight.grad().defined(), weight_trained);
      if (input_trained) {
        EXPECT_TRUE(torch::equal(x.grad(), 6.0 * n * n));
      }
      if (weight_trained) {
        EXPECT_TRUE(torch::equal(part.weight.grad(), 3.0 * n * n));
      }
    }
  }
}

TEST(Recompute, WithoutRecordingNothingIsRecorded) {
  CountedPart part{numbers(true)};
  const torch::NoGradGuard no_grad;
  EXPECT_FALSE(part.run(numbers(false)).requires_grad());
}

}  // namespace
}  // namespace anigen::nn
