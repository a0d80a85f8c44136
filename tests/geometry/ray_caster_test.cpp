#include "anigen/geometry/ray_caster.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

using Eigen::Vector3d;

/// Two squares of side 2 at z = 0 and z = 1.
RayCaster two_squares() {
  return {{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, {-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}},
          {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}}};
}

TEST(RayCaster, FindsTheFirstSurfaceFromEitherSide) {
  const RayCaster caster = two_squares();
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, -2}, {0, 0, 1}).value(), 2.0, 1e-6);
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, 5}, {0, 0, -1}).value(), 4.0, 1e-6);
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, 0.25}, {0, 0, 1}).value(), 0.75, 1e-6);
  EXPECT_FALSE(caster.first_hit({0.3, 0.1, 0.25}, {1, 0, 0}).has_value());
  EXPECT_FALSE(caster.first_hit({3, 0, -2}, {0, 0, 1}).has_value());
}

TEST(RayCaster, MeasuresLengthWhateverTheDirectionsLength) {
  const RayCaster caster = two_squares();
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, -2}, {0, 0, 1e-200}).value(), 2.0, 1e-6);
  EXPECT_NEAR(caster.first_hit({0, 0, -0.5}, {1e3, 0, 1e3}).value(), std::sqrt(0.5), 1e-6);
}

TEST(RayCaster, SkipsWhatIsNearerThanAsked) {
  const RayCaster caster = two_squares();
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, 0}, {0, 0, 1}, 1e-6).value(), 1.0, 1e-6);
  EXPECT_NEAR(caster.first_hit({0.3, 0.1, -2}, {0, 0, 1}, 2.5).value(), 3.0, 1e-6);
}

TEST(RayCaster, RejectsBadInput) {
  const RayCaster caster = two_squares();
  EXPECT_THROW(caster.first_hit({std::nan(""), 0, 0}, {0, 0, 1}), InputError);
  EXPECT_THROW(caster.first_hit({0, 0, 0}, {0, 0, 0}), InputError);
  EXPECT_THROW(caster.first_hit({0, 0, 0}, {0, std::nan(""), 1}), InputError);
  EXPECT_FALSE(caster.first_hit({1e30, 0, 0}, {-1, 0, 0}).has_value());
  EXPECT_THROW(RayCaster({{0, 0, 0}}, {}), InputError);
  EXPECT_THROW(RayCaster({{0, 0, 0}}, {{0, 0, 1}}), InputError);
}

}  // namespace
}  // namespace anigen::geometry
