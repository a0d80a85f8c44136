#include "anigen/geometry/triangle_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <type_traits>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

struct Soup {
  std::vector<Vector3f> vertices;
  std::vector<Triangle> faces;
};

/// Triangles of all sizes and directions, some without an area, about a place far from the origin.
Soup random_soup(std::size_t count, float reach, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> exponent(-3.0f, 0.0f);
  Soup soup;
  for (std::size_t f = 0; f < count; ++f) {
    const Vector3f center = Vector3f(normal(random), normal(random), normal(random)) * reach + Vector3f(3, -2, 5);
    const float size = reach * std::pow(10.0f, exponent(random));
    for (int k = 0; k < 3; ++k)
      soup.vertices.push_back(center + size * Vector3f(normal(random), normal(random), normal(random)));
    if (f % 17 == 3) soup.vertices.back() = soup.vertices[soup.vertices.size() - 2];
    const auto first = static_cast<std::int32_t>(3 * f);
    soup.faces.push_back({first, first + 1, first + 2});
  }
  return soup;
}

/// A closed grid around a sphere, which shares all vertices and edges.
Soup sphere(int rings, int segments) {
  Soup soup;
  for (int r = 0; r <= rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const double polar = M_PI * r / rings, around = 2.0 * M_PI * s / segments;
      soup.vertices.push_back(
          Vector3d(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar))
              .cast<float>());
    }
  }
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const int a = r * segments + s, b = r * segments + (s + 1) % segments;
      soup.faces.push_back({a, a + segments, b});
      soup.faces.push_back({b, a + segments, b + segments});
    }
  }
  return soup;
}

/// Möller and Trumbore's test of every triangle in turn, in double precision.
TreeHit brute_force(const Soup& soup, const TreeRay& ray) {
  TreeHit best;
  const Vector3d origin = ray.origin.cast<double>(), direction = ray.direction.cast<double>();
  double nearest = ray.farthest;
  for (std::size_t f = 0; f < soup.faces.size(); ++f) {
    const auto corner = [&](std::size_t k) {
      return soup.vertices[static_cast<std::size_t>(soup.faces[f][k])].cast<double>().eval();
    };
    const Vector3d ab = corner(1) - corner(0), ac = corner(2) - corner(0), p = direction.cross(ac);
    const double determinant = ab.dot(p);
    if (determinant == 0.0) continue;
    const Vector3d from = origin - corner(0), q = from.cross(ab);
    const double u = from.dot(p) / determinant, v = direction.dot(q) / determinant, t = ac.dot(q) / determinant;
    if (u < 0.0 || v < 0.0 || u + v > 1.0 || !(t > ray.nearest && t < nearest)) continue;
    nearest = t;
    best = {static_cast<std::uint32_t>(f), static_cast<float>(t), static_cast<float>(u), static_cast<float>(v)};
  }
  return best;
}

template <typename Tree>
class TriangleTrees : public testing::Test {};
using Trees = testing::Types<PlainTree, EmbreeTree>;
TYPED_TEST_SUITE(TriangleTrees, Trees);

TYPED_TEST(TriangleTrees, FindTheTriangleThatBruteForceFinds) {
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  for (const std::size_t count : {1U, 2U, 9U, 200U, 3000U}) {
    const Soup soup = random_soup(count, 2.0f, static_cast<unsigned>(count));
    const TypeParam tree(soup.vertices, soup.faces);
    int hits = 0, differ = 0;
    for (int i = 0; i < 400; ++i) {
      TreeRay ray;
      ray.origin = Vector3f(normal(random), normal(random), normal(random)) * 6.0f;
      const Vector3f to = soup.vertices[static_cast<std::size_t>(i) % soup.vertices.size()] +
                          0.1f * Vector3f(normal(random), normal(random), normal(random));
      ray.direction = i % 5 == 0 ? Vector3f::Unit(i % 3) : Vector3f(to - ray.origin);
      ray.nearest = i % 7 == 0 ? 0.3f : 0.0f;
      if (i % 11 == 0) ray.farthest = 0.8f;
      const TreeHit expected = brute_force(soup, ray), found = tree.first_hit(ray);
      EXPECT_EQ(tree.is_blocked(ray), found.found());
      if (expected.found()) ++hits;
      // A ray along an edge may go either way, and Embree is in single precision.
      if (expected.face != found.face) {
        ++differ;
        continue;
      }
      if (!expected.found()) continue;
      EXPECT_NEAR(found.distance, expected.distance, 1e-4 * (1.0 + expected.distance));
      const auto at = [&](const TreeHit& hit) -> Vector3f {
        const Triangle& face = soup.faces[hit.face];
        const auto corner = [&](std::size_t k) { return soup.vertices[static_cast<std::size_t>(face[k])]; };
        return (1 - hit.u - hit.v) * corner(0) + hit.u * corner(1) + hit.v * corner(2);
      };
      EXPECT_NEAR((at(found) - (ray.origin + found.distance * ray.direction)).norm(), 0.0, 1e-3);
    }
    EXPECT_LE(differ, 2) << count;
    if (count > 100) {
      EXPECT_GT(hits, 100) << count;
    }
  }
}

TYPED_TEST(TriangleTrees, LetNoRaySlipThroughAClosedSurface) {
  const Soup soup = sphere(60, 90);
  const TypeParam tree(soup.vertices, soup.faces);
  std::mt19937 random(8);
  std::uniform_int_distribution<std::size_t> any(0, soup.vertices.size() - 1);
  for (int i = 0; i < 3000; ++i) {
    // At middles of edges and at vertices, from the inside; Embree 3 misses some of the latter.
    const Vector3f a = soup.vertices[any(random)];
    const Triangle& face = soup.faces[any(random)];
    const Vector3f middle =
        0.5f * (soup.vertices[static_cast<std::size_t>(face[0])] + soup.vertices[static_cast<std::size_t>(face[1])]);
    const Vector3f origin(0.1f, -0.2f, 0.05f);
    if (std::is_same_v<TypeParam, PlainTree>) {
      EXPECT_TRUE(tree.first_hit({origin, a - origin}).found());
    }
    EXPECT_TRUE(tree.is_blocked({origin, middle - origin}));
  }
}

TYPED_TEST(TriangleTrees, TraceBundlesLikeSingleRays) {
  const Soup soup = random_soup(500, 2.0f, 3);
  const TypeParam tree(soup.vertices, soup.faces);
  const Vector3f origin(-4, 1, 2);
  RayBundle directions;
  for (std::size_t i = 0; i < kRayBundle; ++i)
    directions[i] = Vector3f(7, -3, 3) + 0.2f * Vector3f(static_cast<float>(i % 4), static_cast<float>(i / 4), 0);
  const BundleHits hits = tree.first_hits(origin, directions);
  for (std::size_t i = 0; i < kRayBundle; ++i) {
    const TreeHit single = tree.first_hit({origin, directions[i]});
    EXPECT_EQ(hits[i].face, single.face);
    EXPECT_EQ(hits[i].found(), single.found());
    if (single.found()) {
      EXPECT_NEAR(hits[i].distance, single.distance, 1e-5);
    }
  }
}

TYPED_TEST(TriangleTrees, VisitEveryFaceWhoseBoxIsWithinTheRadius) {
  const Soup soup = random_soup(800, 2.0f, 4);
  const TypeParam tree(soup.vertices, soup.faces);
  const Vector3d point(2.5, -1.0, 4.0);
  for (const float radius : {0.0f, 0.3f, 1.5f, std::numeric_limits<float>::infinity()}) {
    std::set<std::uint32_t> visited;
    tree.visit_within(
        point, radius,
        [](void* data, std::uint32_t face, float reach) {
          static_cast<std::set<std::uint32_t>*>(data)->insert(face);
          return reach;
        },
        &visited);
    for (std::size_t f = 0; f < soup.faces.size(); ++f) {
      Eigen::Array3d low = Eigen::Array3d::Constant(1e30), high = -low;
      for (const std::int32_t corner : soup.faces[f]) {
        const Eigen::Array3d place = soup.vertices[static_cast<std::size_t>(corner)].cast<double>().array();
        low = low.min(place);
        high = high.max(place);
      }
      const double distance = (low - point.array()).max(point.array() - high).max(0.0).matrix().norm();
      if (distance <= 0.999 * static_cast<double>(radius)) {
        EXPECT_EQ(visited.count(static_cast<std::uint32_t>(f)), 1U);
      }
    }
  }
}

TYPED_TEST(TriangleTrees, SearchesShrinkTheirRadius) {
  const Soup soup = sphere(100, 100);
  const TypeParam tree(soup.vertices, soup.faces);
  int visits = 0;
  tree.visit_within(
      {0.0, 0.0, 1.5}, std::numeric_limits<float>::infinity(),
      [](void* data, std::uint32_t, float) {
        ++*static_cast<int*>(data);
        return 0.52f;
      },
      &visits);
  EXPECT_LT(visits, 2000);
  EXPECT_GT(visits, 50);
}

TYPED_TEST(TriangleTrees, StandMeshesWithoutFacesAndFacesAtOnePoint) {
  const TypeParam empty({}, {});
  EXPECT_FALSE(empty.first_hit({Vector3f::Zero(), Vector3f::UnitX()}).found());
  EXPECT_FALSE(empty.is_blocked({Vector3f::Zero(), Vector3f::UnitX()}));
  empty.visit_within(
      Vector3d::Zero(), 1.0f, [](void*, std::uint32_t, float radius) { return radius; }, nullptr);
  Soup heap{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, std::vector<Triangle>(5000, Triangle{0, 1, 2})};
  const TypeParam tree(heap.vertices, heap.faces);
  EXPECT_NEAR(tree.first_hit({Vector3f(0.2f, 0.2f, 1), -Vector3f::UnitZ()}).distance, 1.0f, 1e-6);
  EXPECT_THROW(TypeParam({{0, 0, 0}}, {{0, 0, 1}}), InputError);
  EXPECT_THROW(TypeParam({{NAN, 0, 0}}, {{0, 0, 0}}), InputError);
}

TEST(PlainTree, StandsHugeAndTinyMeshes) {
  for (const float scale : {1e-12f, 1e14f}) {
    Soup soup = sphere(20, 20);
    for (Vector3f& vertex : soup.vertices) vertex *= scale;
    const PlainTree tree(soup.vertices, soup.faces);
    const TreeHit hit = tree.first_hit({Vector3f(0, 0, 2 * scale), Vector3f(0.01f, 0.02f, -1)});
    ASSERT_TRUE(hit.found()) << scale;
    EXPECT_NEAR(hit.distance / scale, 1.0, 0.01);
  }
}

}  // namespace
}  // namespace anigen::geometry
