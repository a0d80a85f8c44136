#include "anigen/metrics/shell_gaps.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

#include "anigen/core/error.h"
#include "anigen/geometry/nearest_surface.h"
#include "tests/support/hinged_boxes.h"

namespace anigen::metrics {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TriangleCorners random_triangle(std::mt19937& random, double size, const Vector3d& middle) {
  std::uniform_real_distribution<double> place(-size, size);
  TriangleCorners corners;
  for (Vector3d& corner : corners) corner = middle + Vector3d(place(random), place(random), place(random));
  return corners;
}

Vector3d point_of(const TriangleCorners& c, double u, double v) { return (1 - u - v) * c[0] + u * c[1] + v * c[2]; }

/// Least distance over a grid of points of the first triangle: never below the true one.
double sampled_distance(const TriangleCorners& a, const TriangleCorners& b, int steps) {
  double least = 1e300;
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; i + j <= steps; ++j) {
      const Vector3d p = point_of(a, static_cast<double>(i) / steps, static_cast<double>(j) / steps);
      least = std::min(least, geometry::nearest_on_triangle(p, b[0], b[1], b[2]).distance);
    }
  }
  return least;
}

TEST(TriangleDistance, AgreesWithSamples) {
  std::mt19937 random(5);
  for (int round = 0; round < 300; ++round) {
    const double away = 0.02 * round;
    const TriangleCorners a = random_triangle(random, 1.0, Vector3d::Zero());
    const TriangleCorners b = random_triangle(random, 1.0, {away, 0, 0});
    const double exact = triangle_distance(a, b), sampled = sampled_distance(a, b, 60);
    EXPECT_NEAR(triangle_distance(b, a), exact, 1e-12);
    EXPECT_LE(exact, sampled + 1e-12) << round;
    EXPECT_LE(sampled, exact + 0.06) << round;  // steps of a grid are up to 3.5 / 60 long
  }
}

TEST(TriangleDistance, ByHand) {
  const TriangleCorners flat{Vector3d(0, 0, 0), Vector3d(2, 0, 0), Vector3d(0, 2, 0)};
  EXPECT_EQ(triangle_distance(flat, {Vector3d(.2, .2, -1), Vector3d(.3, .2, 1), Vector3d(.2, .3, 1)}), 0.0)
      << "pierced";
  EXPECT_NEAR(triangle_distance(flat, {Vector3d(.2, .2, .5), Vector3d(.3, .2, 1), Vector3d(.2, .3, 1)}), 0.5, 1e-15);
  // Edge against edge: (1, 1, 0) is the middle of the slanted edge.
  EXPECT_NEAR(triangle_distance(flat, {Vector3d(2, 2, -1), Vector3d(2, 2, 1), Vector3d(3, 3, 0)}), std::sqrt(2.0),
              1e-15);
  EXPECT_NEAR(triangle_distance(flat, {Vector3d(5, 0, 0), Vector3d(5, 0, 0), Vector3d(5, 0, 0)}), 3.0, 1e-15)
      << "a point";
  EXPECT_EQ(triangle_distance(flat, {Vector3d(.1, .1, 0), Vector3d(.2, .1, 0), Vector3d(.1, .2, 0)}), 0.0)
      << "one plane";
}

std::vector<Vector3f> turned(const Asset& boxes, std::size_t from, const Vector3d& center, const Vector3d& axis,
                             double angle) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  std::vector<Vector3f> posed = boxes.mesh.vertices;
  for (std::size_t v = from; v < posed.size(); ++v)
    posed[v] = (center + turn * (posed[v].cast<double>() - center)).cast<float>();
  return posed;
}

// The second box turns by 45 degrees about a line along Y. Where that is the nearest lower edge of the box, the edge
// stays and the gap does not grow. About a line at (0, ·, 1), half a unit above both boxes, it swings to +X and up: its
// upper near edge (g/2, ·, ½) goes to (g/2 cos + ½ sin, ·, 1 + g/2 sin − ½ cos), above the first box, whose edge
// (−g/2, ·, ½) it is nearest to: the near face falls away from there under 45 degrees.
TEST(ShellGaps, GrowAsByHand) {
  const float gap = 0.01F;
  const Asset boxes = test::hinged_boxes(gap, 0.0F);
  const ShellGaps gaps(boxes.mesh.vertices, boxes.mesh.faces);
  ASSERT_EQ(gaps.pairs().size(), 1U);
  EXPECT_NEAR(gaps.pairs()[0].distance, 0.01, 1e-8);
  EXPECT_EQ(gaps.growth(boxes.mesh.vertices), std::vector<double>{0.0});
  const double quarter = 0.78539816339744831, half = 0.5 * gap, diagonal = std::sqrt(2.01 * 2.01 + 2.0);
  EXPECT_EQ(gaps.growth(turned(boxes, 24, {half, 0, -0.5}, Vector3d::UnitY(), quarter))[0], 0.0);

  const double s = std::sin(quarter), c = std::cos(quarter);
  const Vector3d upper(c * half + s * 0.5, 0, 1 + s * half - c * 0.5), edge(-half, 0, 0.5);
  const Vector3d along(s, 0, -c);  // down the near face
  ASSERT_LT((edge - upper).dot(along), 0.0) << "nearest to the upper edge";
  const double grown = gaps.growth(turned(boxes, 24, {0, 0, 1}, Vector3d::UnitY(), -quarter))[0];
  EXPECT_NEAR(grown, ((upper - edge).norm() - gap) / diagonal, 1e-6);
}

// Moved straight away by a tenth of a unit.
TEST(ShellGaps, AShiftIsTheGrowth) {
  Asset boxes = test::hinged_boxes(0.01F, 0.0F);
  const ShellGaps gaps(boxes.mesh.vertices, boxes.mesh.faces);
  std::vector<Vector3f> posed = boxes.mesh.vertices;
  for (std::size_t v = 24; v < posed.size(); ++v) posed[v].x() += 0.1F;
  EXPECT_NEAR(gaps.growth(posed)[0], 0.1 / std::sqrt(2.01 * 2.01 + 2.0), 1e-6);
  for (std::size_t v = 24; v < posed.size(); ++v) posed[v].x() -= 0.3F;
  EXPECT_EQ(gaps.growth(posed)[0], 0.0) << "parts that go into each other leave no gap";
  EXPECT_THROW(gaps.growth({}), InputError);
}

TEST(ShellGaps, OnlyShellsThatTouchArePairs) {
  const auto pairs = [](float gap) {
    const Asset boxes = test::hinged_boxes(gap, 0.0F);
    return ShellGaps(boxes.mesh.vertices, boxes.mesh.faces).pairs().size();
  };
  EXPECT_EQ(pairs(0.02F), 1U);
  EXPECT_EQ(pairs(0.03F), 0U) << "0.012 of the diagonal";
  EXPECT_EQ(ShellGaps({}, {}).pairs().size(), 0U);
  Mesh mesh;
  for (int i = 0; i < 4; ++i) {
    const float x = 1.01F * static_cast<float>(i);
    test::add_flat_box(mesh, {x, 0, 0}, {x + 1, 1, 1});
  }
  const ShellGaps row(mesh.vertices, mesh.faces);
  ASSERT_EQ(row.pairs().size(), 3U);
  for (std::int32_t i = 0; i < 3; ++i) {
    EXPECT_EQ(row.pairs()[static_cast<std::size_t>(i)].first, i);
    EXPECT_EQ(row.pairs()[static_cast<std::size_t>(i)].second, i + 1);
  }
  EXPECT_EQ(ShellGaps(mesh.vertices, mesh.faces, kTouching, 2).pairs().size(), 2U);
  std::vector<Vector3f> broken = mesh.vertices;
  broken[3].y() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(ShellGaps(broken, mesh.faces), InputError);
}

// The tree finds what a comparison of all faces finds.
TEST(ShellGaps, AgreeWithAllPairsOfFaces) {
  Mesh mesh;
  const auto ball = [&](const Vector3d& middle, double radius) {
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    constexpr int kRings = 12, kSectors = 16;
    for (int r = 0; r <= kRings; ++r) {
      for (int k = 0; k < kSectors; ++k) {
        const double polar = 3.14159265 * (r + 0.02) / (kRings + 0.04), turn = 6.2831853 * k / kSectors;
        mesh.vertices.emplace_back((middle + radius * Vector3d(std::sin(polar) * std::cos(turn),
                                                               std::sin(polar) * std::sin(turn), std::cos(polar)))
                                       .cast<float>());
        if (r == 0) continue;
        const std::int32_t a = first + (r - 1) * kSectors + k, b = first + (r - 1) * kSectors + (k + 1) % kSectors;
        mesh.faces.push_back({a, a + kSectors, b});
        mesh.faces.push_back({b, a + kSectors, b + kSectors});
      }
    }
  };
  ball({0, 0, 0}, 1.0);
  const std::size_t second = mesh.vertices.size(), split = mesh.faces.size();
  ball({1.3, 0.9, 0.4}, 0.65);
  const ShellGaps gaps(mesh.vertices, mesh.faces, 0.05);
  ASSERT_EQ(gaps.pairs().size(), 1U);
  const auto brute = [&](const std::vector<Vector3f>& places) {
    double least = 1e300;
    const auto corners = [&](std::size_t f) {
      TriangleCorners c;
      for (std::size_t k = 0; k < 3; ++k) c[k] = places[static_cast<std::size_t>(mesh.faces[f][k])].cast<double>();
      return c;
    };
    for (std::size_t f = 0; f < split; ++f) {
      for (std::size_t g = split; g < mesh.faces.size(); ++g)
        least = std::min(least, triangle_distance(corners(f), corners(g)));
    }
    return least;
  };
  EXPECT_NEAR(gaps.pairs()[0].distance, brute(mesh.vertices), 1e-12);
  std::vector<Vector3f> posed = mesh.vertices;
  const Eigen::Matrix3f turn = Eigen::AngleAxisf(1.9F, Vector3f(1, 2, 3).normalized()).toRotationMatrix();
  for (std::size_t v = second; v < posed.size(); ++v) posed[v] = turn * posed[v] + Vector3f(0.4F, -0.2F, 0.9F);
  const double diagonal = bounding_box(mesh.vertices).diagonal();
  EXPECT_NEAR(gaps.growth(posed)[0], std::max(0.0, brute(posed) - brute(mesh.vertices)) / diagonal, 1e-12);
}

}  // namespace
}  // namespace anigen::metrics
