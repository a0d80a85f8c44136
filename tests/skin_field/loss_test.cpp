#include "anigen/skin_field/loss.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/skin_field/sampling.h"

namespace anigen::skin_field {
namespace {

using torch::Tensor;

Tensor random_rows(std::int64_t rows, std::int64_t columns) {
  return torch::softmax(2.0 * torch::randn({rows, columns}, torch::kFloat64), 1);
}

TEST(SkinLoss, PublishedAndPaperDifferByTheNumberOfJoints) {
  torch::manual_seed(3);
  const std::vector<Tensor> predicted = {random_rows(6, 4)}, target = {random_rows(6, 4)};
  SkinLossOptions published = SkinLossOptions::compatible("published");
  published.epsilon = 0.0;
  const double elements = skin_losses(predicted, target, published).kl.item<double>();
  const double rows = skin_losses(predicted, target, SkinLossOptions::compatible("paper")).kl.item<double>();
  EXPECT_NEAR(rows, 4.0 * elements, 1e-12);
  EXPECT_THROW(SkinLossOptions::compatible("papper"), InputError);
}

TEST(SkinLoss, DivergenceByHand) {
  const std::vector<Tensor> predicted = {torch::tensor({{0.5, 0.5}}, torch::kFloat64)};
  const std::vector<Tensor> target = {torch::tensor({{1.0, 0.0}}, torch::kFloat64)};  // 0 log 0 counts as 0
  EXPECT_NEAR(skin_losses(predicted, target, SkinLossOptions::compatible("paper")).kl.item<double>(), std::log(2.0),
              1e-12);
}

TEST(SkinLoss, FromLogarithmsEqualsFromWeights) {
  torch::manual_seed(4);
  const std::vector<Tensor> predicted = {random_rows(6, 4), random_rows(3, 7)};
  const std::vector<Tensor> target = {random_rows(6, 4), random_rows(3, 7)};
  std::vector<Tensor> logs;
  for (const Tensor& item : predicted) logs.push_back(item.log());
  SkinLossOptions options;
  options.lambda_l1_skin = 0.5;
  options.lambda_l2_skin = 0.25;
  const double direct = skin_losses(predicted, target, options).total.item<double>();
  EXPECT_NEAR(skin_losses_from_log(logs, target, options).total.item<double>(), direct, 1e-12);
}

TEST(SkinLoss, StaysFiniteWhereTheWeightUnderflows) {
  Tensor log_predicted = torch::tensor({{-1000.0F, 0.0F}}).requires_grad_();
  const std::vector<Tensor> target = {torch::tensor({{1.0F, 0.0F}})};
  const SkinLosses losses = skin_losses_from_log({log_predicted}, target, SkinLossOptions::compatible("paper"));
  losses.total.backward();
  EXPECT_NEAR(losses.kl.item<double>(), 1000.0, 1e-3);
  EXPECT_NEAR(log_predicted.grad()[0][0].item<double>(), -1.0, 1e-6);
}

TEST(SkinLoss, RefusesDifferentShapes) {
  EXPECT_THROW(skin_losses({random_rows(2, 3)}, {random_rows(3, 3)}, {}), InputError);
  EXPECT_THROW(skin_losses({}, {}, {}), InputError);
}

// Two triangles, one three times the other's area.
struct Mesh {
  Tensor vertices = torch::tensor({{0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {0.0F, 1.0F, 0.0F}, {0.0F, -3.0F, 0.0F}});
  Tensor faces = torch::tensor({{0, 1, 2}, {0, 3, 1}}, torch::kInt64);
  Tensor skin = torch::eye(4);
};

TEST(SurfaceSkinSampler, FacesAreDrawnByArea) {
  const Mesh mesh;
  EXPECT_TRUE(torch::allclose(face_probabilities(mesh.vertices, mesh.faces), torch::tensor({0.25F, 0.75F})));
  const SurfaceSkinSampler sampler(mesh.vertices, mesh.faces, mesh.skin);
  Rng rng(5, "skin samples");
  const Tensor sampled = sampler.sample(4000, rng);
  EXPECT_TRUE(torch::allclose(sampled.sum(1), torch::ones({4000}), 1e-5, 1e-5));
  // Points on the large face have weight on vertex 3: binomial(4000, 0.75), five standard deviations are 0.034.
  EXPECT_NEAR((sampled.select(1, 3) > 0).to(torch::kFloat64).mean().item<double>(), 0.75, 0.035);
  // Uniform on a triangle: every corner of it weighs 1/3 on average.
  EXPECT_NEAR(sampled.select(1, 3).mean().item<double>(), 0.25, 0.02);
}

TEST(SurfaceSkinSampler, SameStreamSameSamples) {
  const Mesh mesh;
  const SurfaceSkinSampler sampler(mesh.vertices, mesh.faces, mesh.skin);
  Rng a(5, "skin samples"), b(5, "skin samples");
  EXPECT_TRUE(torch::equal(sampler.sample(50, a), sampler.sample(50, b)));
  EXPECT_FALSE(torch::equal(sampler.sample(50, a), sampler.sample(51, b).narrow(0, 1, 50)));
}

TEST(SurfaceSkinSampler, RefusesBadMeshes) {
  const Mesh mesh;
  const Tensor outside = torch::tensor({{0, 1, 4}}, torch::kInt64);
  EXPECT_THROW(SurfaceSkinSampler(mesh.vertices, outside, mesh.skin), InputError);
  EXPECT_THROW(SurfaceSkinSampler(mesh.vertices, mesh.faces.narrow(0, 0, 0), mesh.skin), InputError);
  EXPECT_THROW(SurfaceSkinSampler(mesh.vertices, mesh.faces, mesh.skin.narrow(0, 0, 3)), InputError);
}

}  // namespace
}  // namespace anigen::skin_field
