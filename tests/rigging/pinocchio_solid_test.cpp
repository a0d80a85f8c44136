#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/geometry/primitives.h"
#include "anigen/rigging/pinocchio_solid.h"
#include "anigen/rigging/pinocchio_spheres.h"
#include "tests/rigging/embedding_bodies.h"

namespace anigen::rigging {
namespace {

/// A box between two corners; `open`: without its upper side.
Mesh solid_box(const Eigen::Vector3f& low, const Eigen::Vector3f& high, bool open = false) {
  Mesh mesh;
  for (int c = 0; c < 8; ++c) {
    mesh.vertices.emplace_back((c & 1) != 0 ? high.x() : low.x(), (c & 2) != 0 ? high.y() : low.y(),
                               (c & 4) != 0 ? high.z() : low.z());
  }
  mesh.faces = {{0, 2, 3}, {0, 3, 1}, {0, 1, 5}, {0, 5, 4}, {1, 3, 7}, {1, 7, 5},
                {3, 2, 6}, {3, 6, 7}, {2, 0, 4}, {2, 4, 6}, {4, 5, 7}, {4, 7, 6}};
  if (open) mesh.faces.resize(10);
  return mesh;
}

Mesh together(const Mesh& a, const Mesh& b) {
  Mesh both = a;
  const auto offset = static_cast<std::int32_t>(a.vertices.size());
  both.vertices.insert(both.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const Triangle& t : b.faces) both.faces.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
  return both;
}

TEST(SolidField, DepthOfASphere) {
  const SolidField field = solid_field(geometry::icosphere(4, 3.0), 1.0, 64);
  for (const double r : {0.0, 0.1, 0.3, 0.45}) {
    EXPECT_NEAR(field.value({r, 0, 0}), r - 0.5, 0.015);
    EXPECT_NEAR(field.value(Eigen::Vector3d(r, -r, r) / std::sqrt(3.0)), r - 0.5, 0.015);
  }
  EXPECT_NEAR(field.value({0.0, 0.0, 0.8}), 0.3, 0.05);
  EXPECT_EQ(field.from_mesh.scale, 1.0 / 6.0);
}

TEST(SolidField, HolesAreClosed) {
  const Eigen::Vector3f half(0.5F, 0.4F, 0.3F);
  const SolidField closed = solid_field(solid_box(-half, half), 1.0, 64);
  const SolidField open = solid_field(solid_box(-half, half, true), 1.0, 64);
  EXPECT_NEAR(open.value({0, 0, 0}), -0.3, 0.01);
  EXPECT_NEAR(static_cast<double>(open.inside_count()), static_cast<double>(closed.inside_count()),
              0.05 * static_cast<double>(closed.inside_count()));
}

TEST(SolidField, OverlapsAndHiddenPartsHaveNoBoundary) {
  const Mesh outer = solid_box({-0.5F, -0.2F, -0.2F}, {0.1F, 0.2F, 0.2F});
  const Mesh other = solid_box({-0.1F, -0.2F, -0.2F}, {0.5F, 0.2F, 0.2F});
  EXPECT_NEAR(solid_field(together(outer, other), 1.0, 64).value({0, 0, 0}), -0.2, 0.01);
  const Mesh around = solid_box({-0.5F, -0.4F, -0.4F}, {0.5F, 0.4F, 0.4F});
  const Mesh eye = solid_box({-0.1F, -0.1F, -0.1F}, {0.1F, 0.1F, 0.1F});
  EXPECT_NEAR(solid_field(together(around, eye), 1.0, 64).value({0, 0, 0}), -0.4, 0.01);
}

TEST(SolidField, EveryFaceTwiceIsStillSolid) {
  const Mesh box = solid_box({-0.5F, -0.4F, -0.3F}, {0.5F, 0.4F, 0.3F});
  EXPECT_NEAR(solid_field(together(box, box), 1.0, 64).value({0, 0, 0}), -0.3, 0.02);
}

TEST(SolidField, SheetsGetAThickness) {
  Mesh sheet;
  sheet.vertices = {{-0.5F, 0, -0.5F}, {0.5F, 0, -0.5F}, {0.5F, 0, 0.5F}, {-0.5F, 0, 0.5F}};
  sheet.faces = {{0, 1, 2}, {0, 2, 3}};
  const SolidField field = solid_field(sheet, 1.0, 64);
  EXPECT_LT(field.value({0.1, 0.0, 0.2}), 0.0);
  EXPECT_GT(field.value({0.1, 0.05, 0.2}), 0.0);
  EXPECT_GT(field.inside_count(), 4000u);
}

TEST(MedialSpheres, AreOnTheAxisOfATube) {
  const SolidField field = solid_field(test::capsule_mesh({{{0, 0, -0.4}, {0, 0, 0.4}, 0.1}}, 48, 16), 1.0, 96);
  const std::vector<Sphere> samples = medial_samples(field, 0.01);
  ASSERT_FALSE(samples.empty());
  for (const Sphere& sample : samples) {
    EXPECT_LT(std::hypot(sample.center.x(), sample.center.y()), 0.025);
    EXPECT_LT(std::abs(sample.center.z()), 0.43);
    EXPECT_NEAR(sample.radius, 0.1, 0.02);
  }
  const std::vector<Sphere> packed = packed_spheres(samples, 1000);
  EXPECT_GE(packed.size(), 7u);
  for (std::size_t a = 0; a < packed.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b)
      EXPECT_GE((packed[a].center - packed[b].center).norm(), packed[b].radius - 1e-12);
  }
  const SphereGraph graph(field, packed);
  EXPECT_EQ(graph.bridges(), 0);
  int low = 0, high = 0;
  for (int v = 0; v < static_cast<int>(graph.size()); ++v) {
    if (graph[v].center.z() < graph[low].center.z()) low = v;
    if (graph[v].center.z() > graph[high].center.z()) high = v;
  }
  EXPECT_NEAR(graph.distance(low, high), graph[high].center.z() - graph[low].center.z(), 0.05);
  double walked = 0.0;
  for (int w = high; graph.before(low, w) >= 0; w = graph.before(low, w))
    walked += (graph[w].center - graph[graph.before(low, w)].center).norm();
  EXPECT_NEAR(walked, graph.distance(low, high), 1e-5);
}

}  // namespace
}  // namespace anigen::rigging
