#include <gtest/gtest.h>

#include "anigen/anymate/blocks.h"
#include "anigen/core/error.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::anymate {
namespace {

// As the released code has it: scores of masked keys are -1e8.
Tensor plainly_masked(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask) {
  const Tensor scores = torch::matmul(q, k.transpose(-2, -1)) / std::sqrt(static_cast<double>(q.size(-1)));
  const Tensor hidden = (mask == 0).unsqueeze(1).unsqueeze(1);
  return torch::matmul(torch::softmax(scores.masked_fill(hidden, -1e8), -1), v);
}

TEST(AnymateAttention, MaskedKeysHaveNoWeight) {
  torch::manual_seed(6);
  // Some keys, all keys and no key of an item; and keys enough that scores are not held whole.
  for (const std::int64_t keys : {6, 300}) {
    Tensor mask = (torch::rand({3, keys}) < 0.6).to(torch::kFloat32);
    mask[1].fill_(1.0);
    mask[2].zero_();
    const auto operand = [](std::int64_t rows) { return torch::randn({3, 2, rows, 8}).requires_grad_(true); };
    const Tensor q = operand(200), k = operand(keys), v = operand(keys), slope = torch::randn({3, 2, 200, 8});
    const Tensor found = masked_attention(q, k, v, KeyMask(mask)), wanted = plainly_masked(q, k, v, mask);
    EXPECT_LT(apart(found, wanted), 2e-6);
    const auto gradients = [&](const Tensor& out) { return torch::autograd::grad({(out * slope).sum()}, {q, k, v}); };
    const auto a = gradients(found), b = gradients(wanted);
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_LT(apart(a[i], b[i]), 2e-4) << i;
  }
}

TEST(AnymateAttention, AMaskMustFit) {
  const Tensor x = torch::zeros({2, 1, 4, 8});
  EXPECT_TRUE(KeyMask(torch::ones({2, 5})).all());  // hides nothing, so it fits everything
  const Tensor mask = torch::tensor({{1, 1, 0, 1}, {1, 0, 0, 1}});
  EXPECT_NO_THROW(masked_attention(x, x, x, KeyMask(mask)));
  EXPECT_THROW(masked_attention(x, x, x, KeyMask(mask.narrow(1, 0, 3))), InputError);
  EXPECT_THROW(masked_attention(x, x, x, KeyMask(mask.narrow(0, 0, 1))), InputError);
  EXPECT_THROW(KeyMask{mask[0]}, InputError);
}

}  // namespace
}  // namespace anigen::anymate
