#include "anigen/asset/animation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/asset/small_rig.h"

namespace anigen {
namespace {

TEST(Sample, LinearRotationTakesTheShorterArc) {
  Asset asset = test::small_rig();
  const Pose half = sample(asset.animations[0], asset.skeleton, 0.5);
  const Eigen::AngleAxisd turn(half[1].rotation);
  EXPECT_NEAR(turn.angle(), std::acos(-1.0) / 4, 1e-9);
  for (int i = 4; i < 8; ++i)
    asset.animations[0].channels[0].values[static_cast<std::size_t>(i)] *= -1;  // same rotation
  EXPECT_NEAR(Eigen::AngleAxisd(sample(asset.animations[0], asset.skeleton, 0.5)[1].rotation).angle(),
              std::acos(-1.0) / 4, 1e-9);
}

TEST(Sample, CubicSplineFollowsTheGltfFormula) {
  const Asset asset = test::small_rig();
  // Keys x = 0 and 2 at t = 0 and 2 s with tangents 1 per second on both sides: exactly x = t.
  for (const double t : {0.0, 0.3, 1.0, 1.7, 2.0})
    EXPECT_NEAR(sample(asset.animations[0], asset.skeleton, t)[0].translation.x(), t, 1e-12);
  EXPECT_EQ(asset.animations[0].duration(), 2.0);
}

TEST(Sample, ClampsOutsideTheKeysAndStepsHold) {
  Asset asset = test::small_rig();
  asset.animations[0].channels[0].interpolation = Interpolation::kStep;
  const auto angle = [&](double t) {
    return Eigen::AngleAxisd(sample(asset.animations[0], asset.skeleton, t)[1].rotation).angle();
  };
  EXPECT_NEAR(angle(-5.0), 0.0, 1e-12);
  EXPECT_NEAR(angle(0.999), 0.0, 1e-12);
  EXPECT_NEAR(angle(99.0), std::acos(-1.0) / 2, 1e-9);
}

}  // namespace
}  // namespace anigen
