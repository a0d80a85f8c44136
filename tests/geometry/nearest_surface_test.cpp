#include "anigen/geometry/nearest_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/bones.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/support/paths.h"

namespace anigen::geometry {
namespace {

/// Distance by dense sampling of the definition: independent of the code under test.
double sampled_distance(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                        const Eigen::Vector3d& c, int steps) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; i + j <= steps; ++j) {
      const double v = double(i) / steps, w = double(j) / steps;
      best = std::min(best, (a + v * (b - a) + w * (c - a) - p).norm());
    }
  }
  return best;
}

Mesh triangle_soup(std::size_t faces, std::uint64_t seed) {
  Rng rng(seed, "soup");
  Mesh mesh;
  for (std::size_t f = 0; f < faces; ++f) {
    const Eigen::Vector3f center(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
    for (int k = 0; k < 3; ++k) {
      mesh.vertices.push_back(center +
                              Eigen::Vector3f(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)));
    }
    const auto first = static_cast<std::int32_t>(3 * f);
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

NearestPoint brute_force(const Mesh& mesh, const Eigen::Vector3d& p) {
  NearestPoint best;
  best.distance = std::numeric_limits<double>::infinity();
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto corner = [&](std::size_t k) {
      return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(mesh.faces[f][k])].cast<double>());
    };
    NearestPoint candidate = nearest_on_triangle(p, corner(0), corner(1), corner(2));
    if (candidate.distance < best.distance) {
      best = candidate;
      best.at.face = static_cast<std::int32_t>(f);
    }
  }
  return best;
}

TEST(NearestOnTriangle, MatchesDenseSamplingAndReturnsConsistentBarycentrics) {
  Rng rng(1, "triangles");
  const auto draw = [&] { return Eigen::Vector3d(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)); };
  constexpr int kSteps = 200;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d a = draw(), b = draw(), c = draw(), p = 1.5 * draw();
    const NearestPoint nearest = nearest_on_triangle(p, a, b, c);
    const double sampled = sampled_distance(p, a, b, c, kSteps);
    EXPECT_LE(nearest.distance, sampled + 1e-12);
    // The grid misses the true point by at most one cell, so the distance by at most the cell's size.
    EXPECT_GE(nearest.distance, sampled - 3.5 / kSteps);
    EXPECT_NEAR(nearest.at.barycentric.sum(), 1.0, 1e-12);
    EXPECT_GE(nearest.at.barycentric.minCoeff(), 0.0);
    const Eigen::Vector3d rebuilt =
        nearest.at.barycentric[0] * a + nearest.at.barycentric[1] * b + nearest.at.barycentric[2] * c;
    EXPECT_LT((rebuilt - nearest.position).norm(), 1e-12);
    EXPECT_NEAR((p - nearest.position).norm(), nearest.distance, 1e-12);
  }
}

TEST(NearestOnTriangle, KnownRegions) {
  const Eigen::Vector3d a(0, 0, 0), b(1, 0, 0), c(0, 1, 0);
  EXPECT_TRUE(nearest_on_triangle({0.25, 0.25, 2}, a, b, c).position.isApprox(Eigen::Vector3d(0.25, 0.25, 0)));
  EXPECT_TRUE(nearest_on_triangle({3, -1, 0}, a, b, c).position.isApprox(b));
  EXPECT_TRUE(nearest_on_triangle({1, 1, 1}, a, b, c).position.isApprox(Eigen::Vector3d(0.5, 0.5, 0)));
  EXPECT_NEAR(nearest_on_triangle({-1, 0.5, 0}, a, b, c).distance, 1.0, 1e-15);
}

TEST(NearestOnTriangle, TriangleWithoutAreaIsItsLongestEdge) {
  const Eigen::Vector3d a(0, 0, 0), b(1, 0, 0), c(3, 0, 0);
  const NearestPoint nearest = nearest_on_triangle({2, 1, 0}, a, b, c);
  EXPECT_NEAR(nearest.distance, 1.0, 1e-15);
  EXPECT_NEAR(nearest.position.x(), 2.0, 1e-15);
  EXPECT_NEAR(nearest.at.barycentric.sum(), 1.0, 1e-15);
  EXPECT_NEAR(nearest_on_triangle({1, 0, 0}, b, b, b).distance, 0.0, 1e-15);
}

TEST(NearestSurface, EqualsBruteForceOverAllFaces) {
  const Mesh mesh = triangle_soup(600, 2);
  const NearestSurface surface(mesh);
  Rng rng(3, "points");
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 400; ++i) {
    const double reach = i % 4 == 0 ? 20.0 : 1.5;
    points.emplace_back(rng.uniform(-reach, reach), rng.uniform(-reach, reach), rng.uniform(-reach, reach));
  }
  const std::vector<NearestPoint> found = surface.query(points);
  ASSERT_EQ(found.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const NearestPoint expected = brute_force(mesh, points[i]);
    EXPECT_EQ(found[i].distance, expected.distance) << i;  // the same double arithmetic: exact
    EXPECT_EQ(found[i].at.face, expected.at.face) << i;
  }
}

// Every real mesh, from points at its surface and points anywhere: the same double arithmetic, so exactly the same
// distance. Faces are equally near to most points beside an edge; then the lowest number counts, for both.
TEST(NearestSurface, RealMeshesHaveNoDifferences) {
  const auto folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "no real meshes at " << folder;
  }
  std::size_t meshes = 0, differences = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".glb" && entry.path().extension() != ".gltf") continue;
    Asset asset = io::read_gltf(entry.path()).asset;
    normalize(asset);
    Rng rng(4, "points", meshes++);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 60; ++i) {
      const double reach = i % 2 == 0 ? 0.02 : 1.0;
      const Eigen::Vector3d offset(rng.uniform(-reach, reach), rng.uniform(-reach, reach), rng.uniform(-reach, reach));
      points.emplace_back(asset.mesh.vertices[rng.index(asset.mesh.vertices.size())].cast<double>() + offset);
    }
    const std::vector<NearestPoint> found = NearestSurface(asset.mesh).query(points);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const NearestPoint expected = brute_force(asset.mesh, points[i]);
      const bool same = found[i].distance == expected.distance && found[i].at.face == expected.at.face;
      differences += same ? 0 : 1;
      EXPECT_TRUE(same) << entry.path() << ", point " << i << ": face " << found[i].at.face << " at "
                        << found[i].distance << ", not " << expected.at.face << " at " << expected.distance;
    }
  }
  std::printf("%zu meshes, %zu differences\n", meshes, differences);
  EXPECT_GT(meshes, 0u);
}

TEST(NearestSurface, EquallyNearFacesGiveTheLowestIndex) {
  // Two identical triangles, and a fan whose shared vertex is the nearest point of all its faces.
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.faces = {{0, 3, 4}, {0, 1, 2}, {0, 1, 2}, {0, 2, 3}};
  const NearestSurface surface(mesh);
  EXPECT_EQ(surface.query(Eigen::Vector3d(0.2, 0.2, 1)).at.face, 1);
  EXPECT_EQ(surface.query(Eigen::Vector3d(0, 0, 1)).at.face, 0);
}

TEST(NearestSurface, FarAwayAndOffCentreMeshesStayExact) {
  Mesh mesh = triangle_soup(200, 5);
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex += Eigen::Vector3f(1e4f, -2e4f, 5e3f);
  const NearestSurface surface(mesh);
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1e4, -2e4, 5e3),
                                   Eigen::Vector3d(1e4 + 0.3, -2e4 - 0.2, 5e3), Eigen::Vector3d(1e20, 0, 0)}) {
    EXPECT_EQ(surface.query(p).distance, brute_force(mesh, p).distance);
  }
}

TEST(NearestSurface, SameResultsOnAnyNumberOfThreads) {
  const Mesh mesh = triangle_soup(300, 6);
  const NearestSurface surface(mesh);
  Rng rng(7, "points");
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 3000; ++i) points.emplace_back(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-2, 2));
  const int before = thread_count();
  set_thread_count(1);
  const std::vector<NearestPoint> one = surface.query(points);
  set_thread_count(4);
  const std::vector<NearestPoint> four = surface.query(points);
  set_thread_count(before);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(one[i].at.face, four[i].at.face);
    ASSERT_EQ(one[i].distance, four[i].distance);
  }
}

TEST(NearestSurface, GuessesOnlySpeedThingsUp) {
  const Mesh mesh = triangle_soup(300, 9);
  const NearestSurface surface(mesh);
  Rng rng(10, "points");
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d point(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-2, 2));
    const NearestPoint plain = surface.query(point);
    for (const std::int32_t guess : {-1, 0, 299, 300, plain.at.face, static_cast<std::int32_t>(rng.index(300))}) {
      const NearestPoint guessed = surface.query(point, guess);
      EXPECT_EQ(guessed.at.face, plain.at.face);
      EXPECT_EQ(guessed.distance, plain.distance);
    }
  }
  // Among equally near faces the lowest wins even over the guess.
  Mesh twice;
  twice.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  twice.faces = {{0, 1, 2}, {0, 1, 2}};
  EXPECT_EQ(NearestSurface(twice).query(Eigen::Vector3d(0.2, 0.2, 1), 1).at.face, 0);
  // Far outside single precision every face is looked at, whatever the guess.
  EXPECT_EQ(surface.query(Eigen::Vector3d(1e20, 0, 0), 7).distance,
            brute_force(mesh, Eigen::Vector3d(1e20, 0, 0)).distance);
}

TEST(NearestSurface, VerticesInDoublePrecisionAreNotRounded) {
  std::vector<Eigen::Vector3d> vertices = {{0.1, 0.1, 0.1}, {1.1, 0.1, 0.1}, {0.1, 1.1, 0.1}};
  const NearestSurface surface(vertices, {{0, 1, 2}});
  EXPECT_NEAR(surface.query(Eigen::Vector3d(0.3, 0.3, 0.1 + 1e-12)).distance, 1e-12, 1e-16);
  vertices[1].x() = 1e300;  // too large for single precision
  EXPECT_THROW(NearestSurface(vertices, {{0, 1, 2}}), InputError);
}

TEST(NearestSurface, FindsEveryFaceWithinADistance) {
  const Mesh mesh = triangle_soup(200, 9);
  const NearestSurface surface(mesh);
  Rng rng(2, "within");
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d p(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
    const std::vector<NearestPoint> found = surface.within(p, 0.3);
    std::size_t expected = 0;
    for (const Triangle& face : mesh.faces) {
      const auto corner = [&](std::size_t k) {
        return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>());
      };
      expected += nearest_on_triangle(p, corner(0), corner(1), corner(2)).distance <= 0.3 ? 1 : 0;
    }
    ASSERT_EQ(found.size(), expected);
    for (std::size_t k = 1; k < found.size(); ++k) EXPECT_LE(found[k - 1].distance, found[k].distance);
    const NearestPoint nearest = surface.query(p);
    if (!found.empty()) {
      EXPECT_EQ(found.front().at.face, nearest.at.face);
      EXPECT_EQ(surface.within(p, nearest.distance).size(), 1u);
    }
    EXPECT_TRUE(surface.within(p, 0.5 * nearest.distance).empty());
  }
  EXPECT_EQ(surface.within(Eigen::Vector3d(1e20, 0, 0), 2e20).size(), 200u);
  EXPECT_THROW(surface.within(Eigen::Vector3d::Zero(), -1.0), InputError);
  EXPECT_THROW(surface.within(Eigen::Vector3d::Zero(), INFINITY), InputError);
  EXPECT_THROW(surface.within(Eigen::Vector3d(NAN, 0, 0), 1.0), InputError);
}

TEST(NearestSurface, RefusesBadInput) {
  const Mesh good = triangle_soup(2, 8);
  EXPECT_THROW(NearestSurface(good.vertices, {}), InputError);
  EXPECT_THROW(NearestSurface(good.vertices, {{0, 1, 6}}), InputError);
  EXPECT_THROW(NearestSurface(good.vertices, {{0, -1, 2}}), InputError);
  Mesh broken = good;
  broken.vertices[4].y() = std::nanf("");
  try {
    NearestSurface surface(broken);
    FAIL() << "a NaN vertex was accepted";
  } catch (const InputError& error) {
    EXPECT_NE(error.place().find("vertices[4]"), std::string::npos) << error.what();
  }
  const NearestSurface surface(good);
  EXPECT_THROW(surface.query(Eigen::Vector3d(0, std::nan(""), 0)), InputError);
  EXPECT_THROW(surface.query(Eigen::Vector3d(1e200, 0, 0)), InputError);
  EXPECT_THROW(surface.query(std::vector<Eigen::Vector3f>{{INFINITY, 0, 0}}), InputError);
  EXPECT_TRUE(surface.query(std::vector<Eigen::Vector3f>{}).empty());
}

}  // namespace
}  // namespace anigen::geometry
