#include "anigen/rigging/medial_ascent.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/geometry/primitives.h"

namespace anigen::rigging {
namespace {

using Eigen::Vector3d;

/// A rod along x, 1 long and 0.2 thick, in its own frame that the field shares.
SolidField rod() {
  Mesh mesh = geometry::icosphere(4, 0.5);
  for (Eigen::Vector3f& vertex : mesh.vertices) {
    const float across = std::hypot(vertex.y(), vertex.z()), radius = std::min(across, 0.1F);
    if (across > 0.0F) vertex.tail<2>() *= radius / across;
  }
  return solid_field(mesh, 1.0, 96);
}

TEST(MedialAscent, PointsComeToTheMiddleOfALimbAndKeepTheirPlaceAlongIt) {
  const SolidField field = rod();
  const std::vector<Vector3d> points = {{0.1, 0.04, 0.03}, {-0.2, 0.0, -0.06}, {0.0, 0.0, 0.0}},
                              middle = ascend_to_medial(field, points, {3, Vector3d(2, 0, 0)}, 0.1);
  ASSERT_EQ(middle.size(), 3u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_DOUBLE_EQ(middle[i].x(), points[i].x());
    EXPECT_LT(middle[i].tail<2>().norm(), field.grid.spacing) << "the ridge is known to a cell";
  }
}

TEST(MedialAscent, NoPointMovesFartherThanTheReach) {
  const SolidField field = rod();
  const Vector3d inside(0.1, 0.08, 0.0), outside(0.1, 0.3, 0.0), along(1, 0, 0);
  const auto moved = ascend_to_medial(field, {inside, outside}, {along, along}, 0.02);
  EXPECT_NEAR((moved[0] - inside).norm(), 0.02, 1e-6);
  EXPECT_NEAR((moved[1] - outside).norm(), 0.02, 1e-6);
  EXPECT_LT(moved[0].y(), inside.y());
  EXPECT_LT(moved[1].y(), outside.y());
  EXPECT_EQ(ascend_to_medial(field, {inside}, {along}, 0.0).front(), inside);
}

TEST(MedialAscent, DepthNeverFalls) {
  const SolidField field = rod();
  std::vector<Vector3d> points, along;
  for (int i = 0; i < 500; ++i) {
    points.emplace_back(0.6 * std::sin(1.0 * i), 0.15 * std::sin(2.3 * i), 0.15 * std::cos(3.1 * i));
    along.emplace_back(std::cos(0.7 * i), std::sin(1.9 * i), std::sin(0.3 * i));
  }
  along[0].setZero();
  const auto moved = ascend_to_medial(field, points, along, 0.03);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LE(field.value(moved[i]), field.value(points[i])) << i;
    EXPECT_NEAR((moved[i] - points[i]).dot(along[i]), 0.0, 1e-12) << i;
  }
}

TEST(MedialAscent, RefusesWhatDoesNotFit) {
  const SolidField field = rod();
  EXPECT_THROW(ascend_to_medial(field, {Vector3d::Zero()}, {}, 0.1), InputError);
  EXPECT_THROW(ascend_to_medial(field, {}, {}, -1.0), InputError);
  EXPECT_THROW(ascend_to_medial(field, {}, {}, std::numeric_limits<double>::quiet_NaN()), InputError);
}

}  // namespace
}  // namespace anigen::rigging
