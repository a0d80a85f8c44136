#include <gtest/gtest.h>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/point_encoders.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::anymate {
namespace {

TEST(AnymateEmbedders, FourierFeaturesGroupSinesBeforeCosines) {
  const Tensor x = torch::tensor({0.25, -0.5}, torch::kFloat64);
  const Tensor y = fourier_features(x, 2, /*include_pi=*/true);
  ASSERT_EQ(y.size(0), fourier_width(2, 2));
  const std::vector<double> angles = {kPi * 0.25, 2.0 * kPi * 0.25, -kPi * 0.5, -kPi};
  for (std::size_t i = 0; i < angles.size(); ++i) {
    EXPECT_NEAR(y[static_cast<std::int64_t>(i) + 2].item<double>(), std::sin(angles[i]), 1e-6);
    EXPECT_NEAR(y[static_cast<std::int64_t>(i) + 6].item<double>(), std::cos(angles[i]), 1e-6);
  }
  EXPECT_THROW(fourier_features(torch::ones({2}, torch::kInt64), 2, true), InputError);
}

// Real spherical harmonics are orthonormal over the sphere: integrated by a grid that is uniform in z and in azimuth,
// which is a midpoint rule in z.
TEST(AnymateEmbedders, HarmonicsAreOrthonormal) {
  constexpr std::int64_t kRings = 400, kSteps = 32;
  const Tensor z = ((torch::arange(kRings, torch::kFloat64) + 0.5) / kRings * 2.0 - 1.0).unsqueeze(1);
  const Tensor angle = (torch::arange(kSteps, torch::kFloat64) / kSteps * 2.0 * kPi).unsqueeze(0);
  const Tensor radius = (1.0 - z * z).sqrt();
  const Tensor directions =
      torch::stack({radius * angle.cos(), radius * angle.sin(), z.expand({kRings, kSteps})}, -1).view({-1, 3});
  const Tensor basis = spherical_harmonics(directions);
  const Tensor products = torch::matmul(basis.t(), basis) * (4.0 * kPi / static_cast<double>(kRings * kSteps));
  EXPECT_LT(apart(products, torch::eye(kHarmonics, torch::kFloat64)), 1e-3);
  EXPECT_THROW(spherical_harmonics(torch::ones({4, 2})), InputError);
}

Tensor line_of_points(const std::vector<float>& x) {
  Tensor points = torch::zeros({1, static_cast<std::int64_t>(x.size()), 3});
  points.select(2, 0).copy_(torch::tensor(x).unsqueeze(0));
  return points;
}

TEST(AnymatePointGroups, FarthestPointsOfALine) {
  const Tensor points = line_of_points({0.0F, 1.0F, 2.0F, 3.0F, 10.0F});
  const Tensor chosen = farthest_points(points, 4, torch::zeros({1}, torch::kInt64));
  EXPECT_TRUE(torch::equal(chosen, torch::tensor({{0, 4, 3, 1}}, torch::kInt64)));  // 1 and 2 tie: the first
  EXPECT_THROW(farthest_points(points, 6, torch::zeros({1}, torch::kInt64)), InputError);
  EXPECT_THROW(farthest_points(points, 2, torch::full({1}, 5, torch::kInt64)), InputError);
  EXPECT_THROW(farthest_points(points, 2, torch::zeros({2}, torch::kInt64)), InputError);
}

TEST(AnymatePointGroups, NearestPointsOfALine) {
  const Tensor points = line_of_points({0.0F, 1.0F, 2.5F, 4.5F, 10.0F});
  const Tensor rows = std::get<0>(nearest_points(points, line_of_points({2.0F, 9.0F}), 2).sort(-1));
  EXPECT_TRUE(torch::equal(rows, torch::tensor({{{1, 2}, {3, 4}}}, torch::kInt64)));
  EXPECT_THROW(nearest_points(points, points, 6), InputError);
}

TEST(AnymateEncoder, EvaluationDrawsNothing) {
  torch::manual_seed(2);
  const torch::NoGradGuard no_grad;
  for (const std::string& encoder : encoder_names()) {
    AnymateModel model(small_model(encoder, "transformer_latent"));
    model->eval();
    const Tensor cloud = small_cloud(2, 30);
    EXPECT_TRUE(torch::equal(model->encode(cloud), model->encode(cloud))) << encoder;
  }
}

TEST(AnymateEncoder, TrainingDrawsAndDrawsCanBeGiven) {
  torch::manual_seed(3);
  const torch::NoGradGuard no_grad;
  const Tensor cloud = small_cloud(2, 30);
  AnymateModel miche(small_model("miche", "transformer_latent"));
  EXPECT_GT(apart(miche->encode(cloud), miche->encode(cloud)), 0.0);
  AnymateModelImpl::EncoderDraws draws;
  draws.posterior_noise = torch::zeros({2, 5, 4});
  const Tensor mean = miche->encode(cloud, draws);
  miche->eval();
  EXPECT_TRUE(torch::equal(miche->encode(cloud), mean));
  draws.posterior_noise = torch::zeros({2, 5, 3});
  EXPECT_THROW(miche->encode(cloud, draws), InputError);

  AnymateModel bert(small_model("bert", "transformer_latent"));
  bert->eval();
  draws.fps_start = torch::full({2}, 17, torch::kInt64);
  EXPECT_GT(apart(bert->encode(cloud, draws), bert->encode(cloud)), 0.0);
}

// The class token sees groups as a set, and a group is a set of points.
TEST(AnymateEncoder, PointBertDoesNotDependOnTheOrderOfPoints) {
  torch::manual_seed(4);
  const torch::NoGradGuard no_grad;
  PointBert bert(small_model("bert", "triplane").bert);
  bert->eval();
  const Tensor cloud = small_cloud(1, 50), order = torch::randperm(50, torch::kInt64);
  const Tensor shuffled = cloud.index_select(1, order);
  const Tensor start = (order == 7).nonzero().flatten();
  EXPECT_LT(apart(bert(cloud, torch::full({1}, 7, torch::kInt64)), bert(shuffled, start)), 1e-5);
}

TEST(AnymateEncoder, StochasticDepthLeavesOutWholeBranches) {
  torch::manual_seed(5);
  const torch::NoGradGuard no_grad;
  PointBertOptions options = small_model("bert", "triplane").bert;
  options.drop_path_rate = 0.9;
  options.num_group = 1;
  PointBert bert(options);
  const PointGroups groups = bert->grouped(small_cloud(1, 20), torch::zeros({1}, torch::kInt64));
  const Tensor features = torch::randn({1, 1, options.encoder_dims});
  bert->eval();
  EXPECT_TRUE(torch::equal(bert->tokens(groups, features), bert->tokens(groups, features)));
  bert->train();
  bool differs = false;
  for (int i = 0; i < 20 && !differs; ++i)
    differs = apart(bert->tokens(groups, features), bert->tokens(groups, features)) > 0.0;
  EXPECT_TRUE(differs);
  options.drop_path_rate = 1.0;
  EXPECT_THROW(PointBert{options}, InputError);
}

}  // namespace
}  // namespace anigen::anymate
