#include "anigen/raytrace/views/view_plan.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/raytrace/views/preview_views.h"
#include "anigen/raytrace/views/projection.h"
#include "tests/raytrace/views_support.h"

namespace anigen::raytrace {
namespace {

Eigen::Vector3d eye(const ViewCamera& view) { return camera_to_world(view).topRightCorner<3, 1>(); }

TEST(ViewPlan, ThreeQuartersOfTheViewsAreAbove) {
  for (const std::size_t n : {12u, 24u, 150u}) {
    std::size_t above = 0;
    for (const ViewCamera& view : feature_views(n, 0.5, 0.25)) above += view.pitch > 0.0;
    EXPECT_NEAR(static_cast<double>(above) / static_cast<double>(n), 0.75, 1.0 / static_cast<double>(n)) << n;
  }
}

TEST(ViewPlan, DirectionsFillTheSphereEvenly) {
  // Within the upper hemisphere the heights of evenly spread directions are uniform, and so are the azimuths.
  std::vector<int> heights(5), octants(8);
  const auto views = feature_views(800, 0.3, 0.7);
  for (const ViewCamera& view : views) {
    const Eigen::Vector3d direction = eye(view) / view.radius;
    if (direction.z() > 0.0) ++heights[std::min<std::size_t>(4, static_cast<std::size_t>(5.0 * direction.z()))];
    const double turn = std::atan2(direction.y(), direction.x()) / (2 * M_PI) + 0.5;
    ++octants[std::min<std::size_t>(7, static_cast<std::size_t>(8.0 * turn))];
  }
  for (const int count : heights) EXPECT_NEAR(count, 120, 2);
  for (const int count : octants) EXPECT_NEAR(count, 100, 3);
}

TEST(ViewPlan, FeatureCamerasAreThePublishedOnes) {
  const auto views = feature_views(24, 0.1, 0.9);
  ASSERT_EQ(views.size(), 24u);
  for (const ViewCamera& view : views) {
    EXPECT_EQ(view.radius, 2.0);
    EXPECT_DOUBLE_EQ(view.fov, 40.0 * M_PI / 180.0);
    const Eigen::Vector3d expected(2 * std::cos(view.yaw) * std::cos(view.pitch),
                                   2 * std::sin(view.yaw) * std::cos(view.pitch), 2 * std::sin(view.pitch));
    EXPECT_LT((eye(view) - expected).norm(), 1e-12);
  }
}

TEST(ViewPlan, ConditionCamerasHoldTheCubeAndFollowTheirDistribution) {
  Rng rng(7, "views");
  const auto views = condition_views(4000, rng);
  double mean = 0.0, lowest = 10.0, highest = 0.0;
  for (const ViewCamera& view : views) {
    EXPECT_NEAR(std::sin(0.5 * view.fov) * view.radius, std::sqrt(0.75), 1e-12);  // the sphere just fits
    lowest = std::min(lowest, view.fov * 180 / M_PI);
    highest = std::max(highest, view.fov * 180 / M_PI);
    mean += 1.0 / (view.radius * view.radius) / static_cast<double>(views.size());
  }
  EXPECT_GE(lowest, 10.0 - 1e-9);
  EXPECT_LT(lowest, 13.0);
  EXPECT_LE(highest, 70.0 + 1e-9);
  EXPECT_GT(highest, 69.0);
  // 1/r² is uniform between sin²(5°)/0.75 and sin²(35°)/0.75; its mean over 4000 draws varies by 0.002.
  const auto inverse_square = [](double degrees) { return std::pow(std::sin(degrees * M_PI / 180), 2) / 0.75; };
  EXPECT_NEAR(mean, 0.5 * (inverse_square(5) + inverse_square(35)), 0.008);
}

TEST(ViewPlan, FrontCamerasFaceTheObject) {
  Rng rng(7, "views");
  const auto views = front_views(400, rng);
  ASSERT_EQ(views.size(), 400u);
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_NEAR(std::sin(0.5 * views[i].fov) * views[i].radius, std::sqrt(0.75), 1e-12);
    const double side = (views[i].yaw + 0.5 * M_PI) * 180 / M_PI, height = views[i].pitch * 180 / M_PI;
    EXPECT_GE(side, -60.0 + 120.0 * static_cast<double>(i) / 400.0 - 1e-9);  // one camera in each part of the range
    EXPECT_LE(side, -60.0 + 120.0 * static_cast<double>(i + 1) / 400.0 + 1e-9);
    EXPECT_GE(height, -5.0);
    EXPECT_LE(height, 30.0);
    EXPECT_LT(eye(views[i]).y(), 0.0);  // objects face −Y
  }
  EXPECT_THROW(front_views(0, rng), InputError);
}

TEST(ViewPlan, TheSameSeedGivesTheSameCameras) {
  Rng first(3, "views", 5), second(3, "views", 5), other(3, "views", 6);
  const auto a = condition_views(24, first), b = condition_views(24, second), c = condition_views(24, other);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(camera_to_world(a[i]), camera_to_world(b[i]));
    EXPECT_NE(camera_to_world(a[i]), camera_to_world(c[i]));
  }
}

TEST(ViewPlan, MatricesAreRotationsThatLookAtTheOriginEvenAtThePoles) {
  for (const double pitch : {-90.0, -30.0, 0.0, 75.0, 90.0}) {
    const Eigen::Matrix4d matrix = test::frame_at(123.0, pitch).camera_to_world;
    const Eigen::Matrix3d axes = matrix.topLeftCorner<3, 3>();
    EXPECT_LT((axes.transpose() * axes - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(axes.determinant(), 1.0, 1e-12);
    EXPECT_LT((Eigen::Vector3d(matrix.topRightCorner<3, 1>()) - 2.0 * axes.col(2)).norm(), 1e-12);  // looks along −Z
    EXPECT_GE(axes(2, 1), -1e-12);                                                                  // +Z is up
  }
}

TEST(ViewPlan, RefusesNonsense) {
  Rng rng(1, "views");
  EXPECT_THROW(feature_views(0, 0, 0), InputError);
  EXPECT_THROW(condition_views(0, rng), InputError);
  EXPECT_THROW(preview_turn(0), InputError);
  EXPECT_THROW(camera_to_world({0, 0, -1, 1}), InputError);
  EXPECT_THROW(camera_to_world({0, 0, 2, 0}), InputError);
  EXPECT_THROW(camera_to_world({0, 0, 2, 3.2}), InputError);
  EXPECT_THROW(camera_to_world({std::numeric_limits<double>::quiet_NaN(), 0, 2, 1}), InputError);
}

TEST(Projection, CentreCornersAndBack) {
  const Frame frame = test::frame_at(0, 0);
  const Eigen::Matrix4d world_to_camera = extrinsics(frame);
  const Eigen::Matrix3d normalised = intrinsics(frame);
  const Eigen::Vector3d centre = project({0, 0, 0}, world_to_camera, normalised);
  EXPECT_LT((centre - Eigen::Vector3d(0.5, 0.5, 2.0)).norm(), 1e-12);
  // From +X: +Y is to the right, +Z is up and so towards small v.
  EXPECT_GT(project({0, 0.1, 0}, world_to_camera, normalised).x(), 0.5);
  EXPECT_LT(project({0, 0, 0.1}, world_to_camera, normalised).y(), 0.5);
  // At depth 2 the picture is 2 · 2 tan 20° wide.
  const double half = 2.0 * std::tan(M_PI / 9);
  EXPECT_LT((project({0, half, half}, world_to_camera, normalised) - Eigen::Vector3d(1, 0, 2)).norm(), 1e-12);
  const Eigen::Vector3d point(0.2, -0.3, 0.4);
  EXPECT_LT((unproject(project(point, world_to_camera, normalised), world_to_camera, normalised) - point).norm(),
            1e-12);
}

TEST(Projection, ClipSpaceRunsFromNearToFar) {
  const Eigen::Matrix4d clip = clip_projection(intrinsics_of(1.0), 1.0, 3.0);
  const Eigen::Vector4d near = clip * Eigen::Vector4d(0, 0, 1, 1), far = clip * Eigen::Vector4d(0, 0, 3, 1);
  EXPECT_NEAR(near.z() / near.w(), 0.0, 1e-12);
  EXPECT_NEAR(far.z() / far.w(), 1.0, 1e-12);
  EXPECT_THROW(clip_projection(intrinsics_of(1.0), 3.0, 1.0), InputError);
  EXPECT_THROW(intrinsics_of(0.0), InputError);
  EXPECT_THROW(extrinsics_of(Eigen::Matrix4d::Zero()), InputError);
}

TEST(PreviewViews, MeasureYawFromTheYAxis) {
  ViewCamera preview{0.3, 0.2, 2.0, 1.0};
  const Eigen::Vector3d expected(2 * std::sin(0.3) * std::cos(0.2), 2 * std::cos(0.3) * std::cos(0.2),
                                 2 * std::sin(0.2));
  EXPECT_LT((eye(from_preview(preview)) - expected).norm(), 1e-12);
}

}  // namespace
}  // namespace anigen::raytrace
