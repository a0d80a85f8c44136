#include "anigen/vision/surface_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "anigen/geometry/voxelize.h"
#include "tests/render/shapes.h"

namespace anigen::vision {
namespace {

using Eigen::Vector3d;

constexpr int kResolution = 64;

std::vector<geometry::Voxel> voxels_of(const Asset& asset) {
  return geometry::voxelize_surface(asset.mesh.vertices, asset.mesh.faces, kResolution);
}

/// Two unit squares facing up, at these heights.
Asset sheets(float low, float high) {
  Asset asset;
  asset.name = "sheets";
  for (const float z : {low, high}) {
    const auto first = static_cast<std::int32_t>(asset.mesh.vertices.size());
    for (const auto& [x, y] : {std::pair{-0.5F, -0.5F}, {0.5F, -0.5F}, {0.5F, 0.5F}, {-0.5F, 0.5F}})
      asset.mesh.vertices.emplace_back(x, y, z);
    asset.mesh.faces.push_back({first, first + 1, first + 2});
    asset.mesh.faces.push_back({first, first + 2, first + 3});
  }
  return asset;
}

double mean_of(const std::vector<SurfaceFeature>& rows, std::size_t channel) {
  double sum = 0.0;
  for (const SurfaceFeature& row : rows) sum += row[channel];
  return sum / static_cast<double>(rows.size());
}

TEST(SurfaceFeatures, SphereFromOutside) {
  const Asset asset = test::sphere(0.5F);
  const std::vector<geometry::Voxel> voxels = voxels_of(asset);
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels, kResolution);
  ASSERT_EQ(rows.size(), voxels.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const SurfaceFeature& row = rows[i];
    const Vector3d center = geometry::voxel_center(voxels[i], kResolution);
    const Vector3d foot = center + Vector3d(row[0], row[1], row[2]) / kResolution;
    ASSERT_NEAR(foot.norm(), 0.5, 2e-3) << i;  // the sphere is a polyhedron
    ASSERT_GT(Vector3d(row[3], row[4], row[5]).dot(foot.normalized()), 0.999) << i;
    for (std::size_t c = 6; c < 9; ++c) ASSERT_NEAR(row[c], 0.72, 1e-6);
    ASSERT_EQ(row[9], 1.0F) << i;
    ASSERT_EQ(row[10], 1.0F) << i;
    ASSERT_NEAR(row[11], 1.0, 5e-3) << i;  // the diameter
    ASSERT_EQ(row[12], 1.0F) << i;
    ASSERT_LT(row[14], 0.02F) << i;
  }
  // Curvature 1 / radius, per voxel edge.
  EXPECT_NEAR(mean_of(rows, 13), 2.0 / kResolution, 0.05 * 2.0 / kResolution);
}

TEST(SurfaceFeatures, SphereFromInsideIsConcaveAndClosedIn) {
  Asset asset = test::sphere(0.5F);
  for (Triangle& face : asset.mesh.faces) std::swap(face[1], face[2]);
  for (Eigen::Vector3f& normal : asset.mesh.normals) normal = -normal;
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels_of(asset), kResolution);
  EXPECT_NEAR(mean_of(rows, 13), -2.0 / kResolution, 0.05 * 2.0 / kResolution);
  EXPECT_NEAR(mean_of(rows, 12), 1.0, 5e-3);
  EXPECT_NEAR(mean_of(rows, 11), 1.0, 1e-6);
  // A ray at angle θ to the normal leaves a sphere of radius ½ after cos θ; cosine-weighted, cos θ > r has probability
  // 1 − r².
  EXPECT_NEAR(mean_of(rows, 9), 1.0 - kNearRadius * kNearRadius, 0.03);
  EXPECT_NEAR(mean_of(rows, 10), 1.0 - kFarRadius * kFarRadius, 0.03);
}

TEST(SurfaceFeatures, SheetsSeeTheirDistance) {
  const Asset asset = sheets(-0.05F, 0.15F);
  const std::vector<geometry::Voxel> voxels = voxels_of(asset);
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels, kResolution);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vector3d center = geometry::voxel_center(voxels[i], kResolution);
    if (std::max(std::abs(center.x()), std::abs(center.y())) > 0.2) continue;  // rays of the far radius stay inside
    const bool lower = center.z() < 0.05;
    EXPECT_NEAR(rows[i][5], 1.0, 1e-6);
    EXPECT_NEAR(rows[i][12], lower ? 0.2 : 1.0, 2e-3);
    EXPECT_NEAR(rows[i][11], lower ? 1.0 : 0.2, 2e-3);
    EXPECT_EQ(rows[i][9], 1.0F);
    // From the lower sheet, rays with 0.2 / cos θ > 1/4 reach farther: sin² θ > 1 − 0.8² = 0.36.
    EXPECT_NEAR(rows[i][10], lower ? 1.0 - 0.36 : 1.0, 0.05);
    EXPECT_NEAR(rows[i][13], 0.0, 1e-6);
    EXPECT_NEAR(rows[i][14], 0.0, 1e-6);
    EXPECT_NEAR(rows[i][15], 25.0 / 125.0, 1e-6);
  }
}

TEST(SurfaceFeatures, ReadsMaterialAndTexture) {
  io::Image picture(2, 2, 0xFF0000FFu);
  Asset asset = test::wall_with(picture);
  for (Eigen::Vector3f& vertex : asset.mesh.vertices) vertex *= 0.5F;
  asset.materials[0].base_color = {0.5F, 1.0F, 1.0F, 1.0F};
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels_of(asset), kResolution);
  for (const SurfaceFeature& row : rows) {
    ASSERT_NEAR(row[6], 0.5, 1e-6);
    ASSERT_NEAR(row[7], 0.0, 1e-6);
  }
}

TEST(SurfaceFeatures, StayInTheirRangesAndDoNotDependOnThreads) {
  Asset asset = creatures::make_creature(5, 2);
  normalize(asset);
  const std::vector<geometry::Voxel> voxels = voxels_of(asset);
  const int threads = thread_count();
  set_thread_count(1);
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels, kResolution);
  set_thread_count(2);
  EXPECT_EQ(surface_features(asset, voxels, kResolution), rows);
  set_thread_count(threads);
  for (const SurfaceFeature& row : rows) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      const bool is_signed = c < 6 || c == 13;
      ASSERT_TRUE(row[c] >= (is_signed ? -1.0F : 0.0F) && row[c] <= 1.0F) << c << ": " << row[c];
    }
    ASSERT_NEAR(std::hypot(row[3], row[4], row[5]), 1.0, 1e-5);
    ASSERT_GT(row[15], 0.0F);
  }
  // No channel is the same everywhere: each tells something about a creature.
  for (std::size_t c = 0; c < kSurfaceChannels; ++c) {
    const auto [low, high] =
        std::minmax_element(rows.begin(), rows.end(), [c](const auto& a, const auto& b) { return a[c] < b[c]; });
    EXPECT_GT((*high)[c] - (*low)[c], 0.02F) << c;
  }
}

TEST(SurfaceFeatures, ExtractorRoundsToHalf) {
  const Asset asset = sheets(-0.1F, 0.1F);
  const std::vector<geometry::Voxel> voxels = voxels_of(asset);
  const SurfaceFeatures extractor;
  EXPECT_EQ(extractor.name(), "surface");
  EXPECT_FALSE(extractor.needs_views());
  const io::NdArray array = extractor.extract({asset, voxels, kResolution, {}});
  EXPECT_EQ(array.dtype, io::Dtype::kF16);
  ASSERT_EQ(array.shape, (std::vector<std::int64_t>{static_cast<std::int64_t>(voxels.size()), extractor.channels()}));
  const std::vector<float> values = array.as<float>();
  const std::vector<SurfaceFeature> rows = surface_features(asset, voxels, kResolution);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t c = 0; c < kSurfaceChannels; ++c)
      ASSERT_NEAR(values[kSurfaceChannels * i + c], rows[i][c], 1e-3 * std::abs(rows[i][c]) + 1e-7);
  }
  EXPECT_EQ(extractor.extract({asset, {}, kResolution, {}}).shape, (std::vector<std::int64_t>{0, kSurfaceChannels}));
}

TEST(SurfaceFeatures, RefusesBadInput) {
  const Asset asset = sheets(-0.1F, 0.1F);
  EXPECT_THROW(surface_features(asset, {{0, 0, 64}}, kResolution), InputError);
  EXPECT_THROW(surface_features(asset, {{0, 0, 0}, {0, 0, 0}}, kResolution), InputError);
  EXPECT_THROW(surface_features(asset, {}, 0), InputError);
  EXPECT_THROW(surface_features(Asset(), {{0, 0, 0}}, kResolution), InputError);
  Asset broken = asset;
  broken.mesh.vertices[2].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(surface_features(broken, {{0, 0, 0}}, kResolution), InputError);
  broken = asset;
  broken.mesh.faces[0][1] = 900;
  EXPECT_THROW(surface_features(broken, {{0, 0, 0}}, kResolution), InputError);
  broken = asset;
  broken.mesh.face_materials.assign(broken.mesh.faces.size(), 3);
  EXPECT_THROW(surface_features(broken, {{0, 0, 0}}, kResolution), InputError);
}

}  // namespace
}  // namespace anigen::vision
