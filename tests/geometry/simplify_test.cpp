#include "anigen/geometry/simplify.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/primitives.h"
#include "anigen/geometry/sampling.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::geometry {
namespace {

Mesh torus(int around, int across) {
  Mesh mesh;
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = 2 * kPi * i / around, v = 2 * kPi * j / across, r = 0.35 + 0.12 * std::cos(v);
      mesh.vertices.push_back(Eigen::Vector3d(r * std::cos(u), r * std::sin(u), 0.12 * std::sin(v)).cast<float>());
      const auto at = [&](int a, int b) { return (a % around) * across + b % across; };
      mesh.faces.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.faces.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

/// Largest distance of points spread over `from` to the surface of `to`.
double largest_distance(const Mesh& from, const Mesh& to) {
  Rng rng(1, "distance");
  const NearestSurface surface(to);
  double largest = 0.0;
  for (const SurfacePoint& point : sample_surface(from.vertices, from.faces, 5000, rng))
    largest = std::max(largest, surface.query(position(point, from.vertices, from.faces)).distance);
  return largest;
}

TEST(Simplify, KeepsASphereClosedAndRound) {
  const Mesh sphere = icosphere(5, 0.5);
  const std::size_t target = reduced_face_count(sphere.faces.size(), kPublishedReduction);
  const Simplified result = simplify(sphere.vertices, sphere.faces, target);
  EXPECT_TRUE(result.reached);
  EXPECT_EQ(result.faces_before, 20480u);
  EXPECT_EQ(result.mesh.faces.size(), target);
  EXPECT_EQ(result.locked, 0u);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(test::euler_characteristic(result.mesh), 2);
  // The middles of this many equilateral triangles with corners on the sphere, 0.084 a side, lie 0.0024 below it; not
  // all are equilateral. The mean over such a triangle is three quarters of that, 1.1 % of the volume.
  EXPECT_LT(largest_distance(result.mesh, sphere), 0.004);
  EXPECT_LT(largest_distance(sphere, result.mesh), 0.004);
  EXPECT_NEAR(test::enclosed_volume(result.mesh), kPi / 6.0, 0.011 * kPi / 6.0);
}

TEST(Simplify, KeepsHandlesAndParts) {
  const Mesh mesh = test::together(torus(80, 40), icosphere(3, 0.1));
  const Simplified result = simplify(mesh.vertices, mesh.faces, 300);
  EXPECT_TRUE(result.reached);
  EXPECT_LE(result.mesh.faces.size(), 300u);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(test::euler_characteristic(result.mesh), 0 + 2);
  EXPECT_LT(largest_distance(mesh, result.mesh), 0.02);
}

TEST(Simplify, SaysWhenTopologyAllowsNoLess) {
  const Mesh mesh = test::together(torus(20, 10), icosphere(2, 0.1));
  const Simplified result = simplify(mesh.vertices, mesh.faces, 1);
  EXPECT_FALSE(result.reached);
  // The smallest torus without folded faces has 14, the smallest sphere 4; turning faces may stop it sooner.
  EXPECT_GE(result.mesh.faces.size(), 18u);
  EXPECT_LT(result.mesh.faces.size(), 100u);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(test::euler_characteristic(result.mesh), 2);
}

TEST(Simplify, KeepsTheBorderOfAFlatSheet) {
  constexpr int kSide = 30;
  Mesh sheet;
  for (int i = 0; i <= kSide; ++i) {
    for (int j = 0; j <= kSide; ++j) sheet.vertices.emplace_back(i / 30.0f + 5.0f, j / 30.0f, 0.0f);
  }
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      const int a = i * (kSide + 1) + j;
      sheet.faces.push_back({a, a + kSide + 1, a + 1});
      sheet.faces.push_back({a + 1, a + kSide + 1, a + kSide + 2});
    }
  }
  const Simplified result = simplify(sheet.vertices, sheet.faces, 40);
  EXPECT_TRUE(result.reached);
  EXPECT_EQ(test::euler_characteristic(result.mesh), 1);
  EXPECT_EQ(test::edge_census(result.mesh.faces).crowded, 0u);
  double area = 0.0;
  for (const Triangle& face : result.mesh.faces) {
    const auto corner = [&](std::size_t k) { return result.mesh.vertices[static_cast<std::size_t>(face[k])]; };
    const double twice = (corner(1) - corner(0)).cross(corner(2) - corner(0)).z();
    EXPECT_GT(twice, 0.0);  // none turned over
    area += 0.5 * twice;
  }
  EXPECT_NEAR(area, 1.0, 0.01);
  const Box box = bounding_box(result.mesh.vertices);
  EXPECT_LT((box.low - Eigen::Vector3d(5, 0, 0)).norm(), 0.01);
  EXPECT_LT((box.high - Eigen::Vector3d(6, 1, 0)).norm(), 0.01);
}

TEST(Simplify, LeavesEdgesOfThreeFacesAlone) {
  // Three half discs that share a diameter of eight edges.
  Mesh mesh;
  constexpr int kRings = 8, kParts = 8;
  for (int r = 0; r <= kRings; ++r) mesh.vertices.emplace_back(0.0f, 0.0f, static_cast<float>(r) / kRings);
  for (int leaf = 0; leaf < 3; ++leaf) {
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    const double angle = 2 * kPi * leaf / 3;
    for (int s = 1; s <= kParts; ++s) {
      for (int r = 0; r <= kRings; ++r) {
        mesh.vertices.emplace_back(static_cast<float>(std::cos(angle) * s / kParts),
                                   static_cast<float>(std::sin(angle) * s / kParts), static_cast<float>(r) / kRings);
      }
    }
    const auto at = [&](int s, int r) { return s == 0 ? r : first + (s - 1) * (kRings + 1) + r; };
    for (int s = 0; s < kParts; ++s) {
      for (int r = 0; r < kRings; ++r) {
        mesh.faces.push_back({at(s, r), at(s + 1, r), at(s + 1, r + 1)});
        mesh.faces.push_back({at(s, r), at(s + 1, r + 1), at(s, r + 1)});
      }
    }
  }
  const Simplified result = simplify(mesh.vertices, mesh.faces, 100);
  EXPECT_EQ(result.locked, 9u);
  EXPECT_LE(result.mesh.faces.size(), 100u);
  EXPECT_EQ(test::edge_census(result.mesh.faces).crowded, 8u);
}

TEST(Simplify, GivesNoEdgeAThirdFaceHoweverTornTheSurface) {
  Mesh torn = icosphere(4, 0.5);
  Rng rng(2, "tears");
  torn.faces.erase(
      std::remove_if(torn.faces.begin(), torn.faces.end(), [&](const Triangle&) { return rng.uniform() < 0.3; }),
      torn.faces.end());
  ASSERT_EQ(test::edge_census(torn.faces).crowded, 0u);
  const Simplified result = simplify(torn.vertices, torn.faces, 100);
  // Nearly every vertex is on a border, which edges inside the surface must not pinch.
  EXPECT_LT(result.mesh.faces.size(), torn.faces.size() * 3 / 4);
  EXPECT_EQ(test::edge_census(result.mesh.faces).crowded, 0u);
}

TEST(Simplify, DropsFacesThatAreOnlyAnEdgeAndIsDeterministic) {
  Mesh sphere = icosphere(3, 0.5);
  sphere.faces.push_back({4, 4, 7});
  const Simplified first = simplify(sphere.vertices, sphere.faces, 200);
  const Simplified second = simplify(sphere.vertices, sphere.faces, 200);
  EXPECT_TRUE(test::edge_census(first.mesh.faces).is_closed());
  EXPECT_EQ(first.mesh.faces, second.mesh.faces);
  EXPECT_EQ(first.mesh.vertices, second.mesh.vertices);
  const Simplified same = simplify(sphere.vertices, sphere.faces, 5000);
  EXPECT_TRUE(same.reached);
  EXPECT_EQ(same.mesh.faces.size(), 1280u);
}

TEST(Simplify, CountsAndRefusals) {
  EXPECT_EQ(reduced_face_count(1000, 0.95), 50u);
  EXPECT_EQ(reduced_face_count(3, 0.95), 1u);
  EXPECT_EQ(reduced_face_count(7, 0.0), 7u);
  EXPECT_THROW(reduced_face_count(7, 1.0), InputError);
  EXPECT_THROW(reduced_face_count(7, -0.1), InputError);
  EXPECT_THROW(simplify({{0, 0, 0}}, {{0, 0, 0}}, 0), InputError);
  EXPECT_THROW(simplify({{0, 0, 0}}, {{0, 1, 2}}, 1), InputError);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(simplify({{0, 0, 0}, {nan, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}, 1), InputError);
}

}  // namespace
}  // namespace anigen::geometry
