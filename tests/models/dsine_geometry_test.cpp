#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/models/normal_estimator/convex_upsampling.h"
#include "anigen/models/normal_estimator/normal_propagation.h"
#include "anigen/models/normal_estimator/picture_normals.h"
#include "tests/nn/largest_difference.h"

namespace anigen::models {
namespace {

using nn::largest_difference;

constexpr double kRounding = 1e-12;  // of a few operations in fp64

Tensor drawn(std::uint64_t seed, torch::IntArrayRef shape) {
  torch::manual_seed(seed);
  return torch::randn(shape, torch::kFloat64);
}

/// Unit normals that point away from a camera in front of them.
Tensor drawn_normals(std::uint64_t seed, torch::IntArrayRef shape) {
  Tensor normals = 0.4 * drawn(seed, shape);
  normals.select(1, 2) += 2.0;
  return unit_vectors(normals);
}

TEST(DsinePadding, IsEvenAndMakesMultiplesOf32) {
  const PicturePadding none = dsine_padding(64, 96);
  EXPECT_EQ(none.left + none.right + none.top + none.bottom, 0);
  const PicturePadding padding = dsine_padding(90, 151);  // the reference's sizes, one column more
  EXPECT_EQ(padding.top, 3);
  EXPECT_EQ(padding.bottom, 3);
  EXPECT_EQ(padding.left, 4);
  EXPECT_EQ(padding.right, 5);
}

TEST(DsineCamera, SeesSixtyDegreesAcrossTheLongerSide) {
  const PinholeCamera camera = PinholeCamera::of_picture(90, 150);
  EXPECT_NEAR(camera.focal_u, 75.0 * std::sqrt(3.0), 1e-10);
  EXPECT_EQ(camera.focal_u, camera.focal_v);
  const Tensor like = torch::zeros({1}, torch::kFloat64);
  const PinholeCamera padded = camera.padded(5, 3);
  const Tensor slopes = ray_slopes(padded, 96, 160, like);
  EXPECT_EQ(slopes.sizes(), torch::IntArrayRef({1, 2, 96, 160}));
  // The picture's left border is half a pixel left of the centre of its first column, 30° off the axis.
  const double half_pixel = 0.5 / camera.focal_u;
  EXPECT_NEAR(slopes[0][0][0][5].item<double>() - half_pixel, -std::tan(kPi / 6.0), kRounding);
  EXPECT_NEAR(slopes[0][1][3][0].item<double>() - half_pixel, -45.0 / camera.focal_v, kRounding);
  // A pixel of the reduced grid lies in the middle of its 8 × 8 pixels.
  const Tensor coarse = ray_slopes(padded.reduced(8), 12, 20, like);
  EXPECT_LT(largest_difference(coarse, at::avg_pool2d(slopes, 8)), kRounding);
  const Tensor rays = unit_rays(slopes);
  EXPECT_LT((rays.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  EXPECT_LT(largest_difference(rays.slice(1, 0, 2) / rays.slice(1, 2, 3), slopes), kRounding);
}

TEST(RayRelu, RaisesTheComponentAlongTheRay) {
  const Tensor rays = unit_vectors(drawn(1, {1, 3, 4, 5})), normals = unit_vectors(drawn(2, {2, 3, 4, 5}));
  const Tensor cosine = (normals * rays).sum(1, true), raised = ray_relu(normals, rays);
  const Tensor along = (raised * rays).sum(1, true);
  ASSERT_LT(cosine.min().item<double>(), 0.0);
  ASSERT_GT(cosine.max().item<double>(), 0.01);
  EXPECT_LT((raised.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  // Seen from the front: left alone.
  EXPECT_LT(((raised - normals).abs() * (cosine > 0.01)).max().item<double>(), kRounding);
  // From behind: what is across the ray stays, with 0.01 along it before the length is made 1 again.
  const Tensor across = normals - cosine * rays;
  EXPECT_LT(((raised - unit_vectors(across + 0.01 * rays)).abs() * (cosine < 0.01)).max().item<double>(), kRounding);
  EXPECT_GT(along.min().item<double>(), 0.0099);
}

TEST(Neighborhood, IsRowByRowAndRepeatsTheBorder) {
  const Tensor x = torch::arange(12, torch::kFloat64).view({1, 1, 3, 4});
  const Tensor around = neighborhood(x, 2);
  ASSERT_EQ(around.sizes(), torch::IntArrayRef({1, 1, 25, 3, 4}));
  for (std::int64_t k = 0; k < 25; ++k) {
    for (std::int64_t row = 0; row < 3; ++row) {
      for (std::int64_t column = 0; column < 4; ++column) {
        const auto at_row = std::clamp<std::int64_t>(row + k / 5 - 2, 0, 2);
        const auto at_column = std::clamp<std::int64_t>(column + k % 5 - 2, 0, 3);
        EXPECT_EQ(around[0][0][k][row][column].item<double>(), static_cast<double>(4 * at_row + at_column));
      }
    }
  }
}

TEST(RotationAxes, LieInThePlaneAndPointAlongTheDirectionInThePicture) {
  const PinholeCamera camera = PinholeCamera::of_picture(12, 16);
  const Tensor normals = drawn_normals(5, {1, 3, 25, 12, 16});
  const Tensor directions = unit_vectors(drawn(6, {1, 2, 25, 12, 16}));
  const Tensor places = neighborhood(pixel_centers(12, 16, normals), 2);
  const Tensor axes = rotation_axes(normals, directions, places, camera);
  EXPECT_LT((axes.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  EXPECT_LT((axes * normals).sum(1).abs().max().item<double>(), 1e-10);
  // A step along the axis moves the picture of the point one step ahead of the place (where DSINE looks) along the
  // direction.
  const Tensor focal = camera.focal(normals).unsqueeze(2), center = camera.center(normals).unsqueeze(2);
  const Tensor slopes = (places + directions - center) / focal;
  const Tensor point = torch::cat({slopes, torch::ones_like(slopes.slice(1, 0, 1))}, 1);
  constexpr double kStep = 1e-6;
  const Tensor moved = point + kStep * axes;
  const Tensor motion = (moved.slice(1, 0, 2) / moved.slice(1, 2, 3) - slopes) * focal;
  EXPECT_LT(largest_difference(unit_vectors(motion), directions), 1e-4);
}

TEST(RotationAxes, AreZeroWhereThereIsNone) {
  const PinholeCamera camera{10.0, 10.0, 4.5, 4.5};
  const Tensor like = torch::zeros({1}, torch::kFloat64);
  const Tensor places = torch::full({1, 2, 1, 1, 1}, 4.5, like.options());
  const Tensor no_direction = torch::zeros({1, 2, 1, 1, 1}, like.options());
  const auto normal = [&](double x, double y, double z) {
    return torch::tensor({x, y, z}, torch::kFloat64).view({1, 3, 1, 1, 1});
  };
  EXPECT_EQ(rotation_axes(normal(0, 0, 1), no_direction, places, camera).abs().max().item<double>(), 0.0);
  // One pixel further down, where the ray is (0, 0.1, 1), this plane is seen edge-on.
  const Tensor down = torch::tensor({0.0, 1.0}, torch::kFloat64).view({1, 2, 1, 1, 1});
  EXPECT_EQ(rotation_axes(normal(0, 1, -0.1), down, places, camera).abs().max().item<double>(), 0.0);
  // Nearly edge-on: along the ray, on the far side or on the near one.
  for (const double sign : {1.0, -1.0}) {
    const Tensor axis = rotation_axes(normal(0, 1, -0.1 + sign * 1e-10), down, places, camera);
    EXPECT_LT(largest_difference(axis, -sign * unit_vectors(normal(0, 0.1, 1))), 1e-6);
  }
}

TEST(RotationAxes, NotANumberBecomesNoAxis) {
  const PinholeCamera camera{10.0, 10.0, 4.5, 4.5};
  const Tensor places = torch::full({1, 2, 1, 1, 1}, 4.5, torch::kFloat64);
  const Tensor down = torch::tensor({0.0, 1.0}, torch::kFloat64).view({1, 2, 1, 1, 1});
  const Tensor nothing = torch::zeros({1, 3, 1, 1, 1}, torch::kFloat64);  // 0 / 0
  EXPECT_EQ(rotation_axes(nothing, down, places, camera).abs().max().item<double>(), 0.0);
}

TEST(Rotated, FollowsTheRightHand) {
  const auto vector = [](double x, double y, double z) {
    return torch::tensor({x, y, z}, torch::kFloat64).view({1, 3, 1});
  };
  const auto angle = [](double value) { return torch::full({1, 1, 1}, value, torch::kFloat64); };
  EXPECT_LT(largest_difference(rotated(vector(1, 0, 0), vector(0, 0, 1), angle(kPi / 2)), vector(0, 1, 0)), kRounding);
  EXPECT_LT(
      largest_difference(rotated(vector(0, 1, 0), vector(1, 0, 0), angle(kPi / 3)), vector(0, 0.5, std::sqrt(0.75))),
      kRounding);
  // As it is where there is no axis, by however much it should turn.
  EXPECT_EQ(largest_difference(rotated(vector(0, 0.6, 0.8), vector(0, 0, 0), angle(2.5)), vector(0, 0.6, 0.8)), 0.0);
  // A turn and the turn back.
  const Tensor axes = unit_vectors(drawn(7, {1, 3, 100})), vectors = drawn(8, {1, 3, 100});
  const Tensor angles = drawn(9, {1, 1, 100});
  const Tensor turned = rotated(vectors, axes, angles);
  EXPECT_LT(largest_difference(rotated(turned, axes, -angles), vectors), kRounding);
  EXPECT_LT(largest_difference((turned * axes).sum(1), (vectors * axes).sum(1)), kRounding);
  EXPECT_GT(largest_difference(turned, vectors), 0.1);
}

class PropagatedNormals : public testing::Test {
 protected:
  static constexpr std::int64_t kHeight = 5, kWidth = 7;
  PinholeCamera camera_ = PinholeCamera::of_picture(kHeight, kWidth);
  Tensor normals_ = drawn_normals(10, {2, 3, kHeight, kWidth});
  Tensor rays_ = unit_rays(ray_slopes(camera_, kHeight, kWidth, normals_));
  NeighborRotations rotations_ = {torch::rand({2, 25, kHeight, kWidth}, torch::kFloat64),
                                  unit_vectors(drawn(11, {2, 2, 25, kHeight, kWidth})),
                                  torch::zeros({2, 25, kHeight, kWidth}, torch::kFloat64)};
};

TEST_F(PropagatedNormals, WithoutATurnAreThoseOfTheNeighbor) {
  const Tensor around = neighborhood(normals_, 2);
  for (const std::int64_t k : {0, 7, 12, 23}) {
    rotations_.weights.zero_();
    rotations_.weights.select(1, k).fill_(0.3);
    const Tensor found = propagated_normals(normals_, rotations_, camera_, rays_);
    EXPECT_LT(largest_difference(found, ray_relu(around.select(2, k), rays_)), kRounding) << k;
  }
}

TEST_F(PropagatedNormals, OfAPlaneStayWithoutATurn) {
  const Tensor plane = unit_vectors(torch::tensor({0.1, -0.2, 1.0}, torch::kFloat64).view({1, 3, 1, 1}));
  const Tensor same = plane.expand_as(normals_).contiguous();
  EXPECT_LT(largest_difference(propagated_normals(same, rotations_, camera_, rays_), same), kRounding);
}

TEST_F(PropagatedNormals, TurnByTheAngleAboutAnAxisInTheirPlane) {
  constexpr double kAngle = 0.05;  // small enough to stay in sight of the camera
  rotations_.weights.zero_();
  rotations_.weights.select(1, 12).fill_(1.0);
  rotations_.angles.fill_(kAngle);
  const Tensor found = propagated_normals(normals_, rotations_, camera_, rays_);
  const Tensor cosine = (found * normals_).sum(1);
  EXPECT_LT((cosine - std::cos(kAngle)).abs().max().item<double>(), kRounding);
}

TEST(ConvexUpsampling, OfAConstantIsTheConstant) {
  const Tensor x = torch::tensor({0.6, -0.3, 2.0}, torch::kFloat64).view({1, 3, 1, 1}).expand({2, 3, 3, 4});
  const Tensor fine = convex_upsampling(x.contiguous(), drawn(12, {2, 576, 3, 4}));
  ASSERT_EQ(fine.sizes(), torch::IntArrayRef({2, 3, 24, 32}));
  EXPECT_LT(largest_difference(fine, x.slice(2, 0, 1).slice(3, 0, 1)), kRounding);
}

TEST(ConvexUpsampling, TakesTheNeighborThatTheMaskNames) {
  const Tensor x = drawn(13, {1, 2, 3, 4}), around = neighborhood(x, 1);
  constexpr std::int64_t q = 5, a = 3, b = 6;  // the neighbour to the right, at row 3 and column 6 within the pixel
  Tensor mask = torch::zeros({1, 576, 3, 4}, torch::kFloat64);
  mask.select(1, q * 64 + a * 8 + b).fill_(1e3);
  const Tensor fine = convex_upsampling(x, mask);
  const auto all = [](std::int64_t start) { return torch::indexing::Slice(start, torch::indexing::None, 8); };
  using torch::indexing::Slice;
  EXPECT_LT(largest_difference(fine.index({Slice(), Slice(), all(a), all(b)}), around.select(2, q)), kRounding);
  EXPECT_LT(largest_difference(fine.index({Slice(), Slice(), all(b), all(a)}), around.mean(2)), kRounding);
}

}  // namespace
}  // namespace anigen::models
