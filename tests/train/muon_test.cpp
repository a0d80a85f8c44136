#include "anigen/train/muon.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen::train {
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
}  // namespace anigen::train
