#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "tests/prepare/augment_support.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TEST(PoseChecks, TellCollapseFromPosing) {
  const Asset asset = tube(5);
  const PoseChecks checks(asset.mesh);
  const PoseLimits limits;
  const auto problem = [&](const auto& move) {
    std::vector<Vector3f> vertices = asset.mesh.vertices;
    for (Vector3f& vertex : vertices) vertex = move(vertex);
    return broken_limit(checks.measure(vertices), limits);
  };
  const auto starts = [](const std::string& text, const char* word) { return text.rfind(word, 0) == 0; };
  EXPECT_TRUE(starts(problem([](Vector3f v) { return v; }), "unchanged"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v + Vector3f(2, 0, 0)); }), "unchanged"));
  // A gentle bend passes.
  EXPECT_EQ(problem([](Vector3f v) { return Vector3f(v.x(), v.y() + v.x() * v.x(), v.z()); }), "");
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * NAN); }), "not finite"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * 1e4f); }), "not finite"));
  // The size of the whole does not matter, since variants are normalised; its shape does.
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * 0.1f); }), "unchanged"));
  EXPECT_EQ(problem([](Vector3f v) { return Vector3f(0.1f * v.x(), 0.1f * (v.y() + v.x() * v.x()), 0.1f * v.z()); }),
            "");
  EXPECT_TRUE(starts(problem([](Vector3f) { return Vector3f(1, 2, 3); }), "vanished"));
  EXPECT_TRUE(
      starts(problem([](Vector3f v) { return Vector3f(v.x(), 1e-3f * v.y(), 1e-3f * v.z()); }), "bounding box"));
  const auto thin_half = [](Vector3f v) {
    const float factor = v.x() > 0.05f ? 0.1f : 1.0f;
    return Vector3f(v.x(), factor * v.y(), factor * v.z());
  };
  EXPECT_TRUE(starts(problem(thin_half), "surface"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v.x(), 0.5f * v.y(), v.z() * 0.5f); }), "volume"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v.x(), v.y(), -v.z()); }), "volume"));
  // One vertex far off pulls a few triangles after it.
  std::vector<Vector3f> torn = asset.mesh.vertices;
  torn[20].z() += 0.6f;
  EXPECT_GT(checks.measure(torn).stretched_share, limits.most_stretched);
  // The second half is pushed through the first: half of the surface lies inside or in the other half.
  PoseMeasures folded = checks.measure([&] {
    std::vector<Vector3f> vertices = asset.mesh.vertices;
    for (std::size_t v = 28; v < vertices.size(); ++v) {
      vertices[v].x() = -vertices[v].x();
      vertices[v].y() *= 0.5f;
      vertices[v].z() *= 0.5f;
    }
    return vertices;
  }());
  EXPECT_GT(folded.buried_share, limits.most_buried);
  EXPECT_THROW(checks.measure({}), InputError);
}

TEST(PoseChecks, VolumeNeedsAClosedSurface) {
  Asset asset = tube(2);
  std::vector<Vector3f> wider = asset.mesh.vertices;
  for (Vector3f& vertex : wider) vertex.y() *= 1.25f;
  const PoseMeasures measures = PoseChecks(asset.mesh).measure(wider);
  EXPECT_NEAR(measures.volume_ratio.value() * std::pow(measures.scale, 3), 1.25, 1e-5);
  asset.mesh.faces.pop_back();
  EXPECT_FALSE(PoseChecks(asset.mesh).measure(wider).volume_ratio.has_value());
}

}  // namespace
}  // namespace anigen::prepare
