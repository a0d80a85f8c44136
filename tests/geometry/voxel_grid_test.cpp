#include "anigen/geometry/voxel_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::geometry {
namespace {

std::vector<Voxel> scattered(std::size_t count, int resolution, std::uint64_t seed) {
  Rng rng(seed, "voxels");
  std::vector<Voxel> voxels(count);
  for (Voxel& voxel : voxels) {
    for (std::int32_t& index : voxel)
      index = static_cast<std::int32_t>(rng.index(static_cast<std::size_t>(resolution)));
  }
  return voxels;
}

/// By the definition: every voxel of the grid that has one of the set within the radius.
std::vector<Voxel> dilated_by_definition(const std::vector<Voxel>& voxels, int resolution, int radius) {
  std::vector<Voxel> result;
  for (int x = 0; x < resolution; ++x) {
    for (int y = 0; y < resolution; ++y) {
      for (int z = 0; z < resolution; ++z) {
        const bool near = std::any_of(voxels.begin(), voxels.end(), [&](const Voxel& v) {
          return std::max({std::abs(v[0] - x), std::abs(v[1] - y), std::abs(v[2] - z)}) <= radius;
        });
        if (near) result.push_back({x, y, z});
      }
    }
  }
  return result;
}

TEST(VoxelGrid, CentersComeBackAtEveryResolution) {
  for (const int resolution : {1, 3, 32, 64, 100, 255, 1024}) {
    for (int i = 0; i < resolution; ++i) {
      const Voxel voxel = {i, resolution - 1 - i, i / 2};
      EXPECT_EQ(voxel_at(voxel_center(voxel, resolution), resolution), voxel);
      // Also in the single precision of voxel files.
      EXPECT_EQ(voxel_at(voxel_center(voxel, resolution).cast<float>().cast<double>(), resolution), voxel);
    }
  }
  EXPECT_EQ(voxel_center({0, 32, 63}, 64), Eigen::Vector3d(-0.5 + 0.5 / 64, 0.5 / 64, 0.5 - 0.5 / 64));
}

TEST(VoxelGrid, ReadingTruncatesTowardZeroAndRefusesOutside) {
  EXPECT_EQ(voxel_at({-0.5, 0, 0.499999}, 64), (Voxel{0, 32, 63}));
  EXPECT_EQ(voxel_at({-0.5 - 0.9 / 64, 0, 0}, 64), (Voxel{0, 32, 32}));
  EXPECT_THROW(voxel_at({-0.5 - 1.1 / 64, 0, 0}, 64), InputError);
  EXPECT_THROW(voxel_at({0, 0.5, 0}, 64), InputError);
  EXPECT_THROW(voxel_at({0, 0, std::nan("")}, 64), InputError);
  EXPECT_THROW(voxel_at({0, 1e300, 0}, 64), InputError);
  EXPECT_THROW(voxel_at({0, 0, 0}, 0), InputError);
}

TEST(VoxelGrid, SubVoxelPointsAreTheCentersOfTheEightParts) {
  const auto points = sub_voxel_points({3, 7, 1}, 8);
  for (std::size_t i = 0; i < 8; ++i) {
    const Voxel part = {6 + static_cast<int>(i >> 2), 14 + static_cast<int>(i >> 1 & 1), 2 + static_cast<int>(i & 1)};
    EXPECT_LT((points[i] - voxel_center(part, 16)).norm(), 1e-15) << i;
  }
}

TEST(VoxelGrid, DilationIsACubeClippedByTheGrid) {
  for (const int resolution : {5, 12}) {
    for (const int radius : {0, 1, 2, 3, 100}) {
      const std::vector<Voxel> voxels = scattered(6, resolution, 1);
      EXPECT_EQ(dilate(voxels, resolution, radius), dilated_by_definition(voxels, resolution, radius));
    }
  }
  EXPECT_EQ(dilate({{32, 32, 32}}, 64, 2).size(), 125u);
  EXPECT_EQ(dilate({{0, 63, 32}}, 64, 2).size(), 45u);
  EXPECT_TRUE(dilate({}, 64, 2).empty());
}

TEST(VoxelGrid, DilationAcrossWordsOfTheBitset) {
  const std::vector<Voxel> voxels = {{1, 1, 63}, {1, 1, 128}};
  std::set<Voxel> expected;
  for (const Voxel& v : voxels) {
    for (int i = 0; i < 27; ++i) expected.insert({v[0] + i / 9 - 1, v[1] + i / 3 % 3 - 1, v[2] + i % 3 - 1});
  }
  EXPECT_EQ(dilate(voxels, 130, 1), std::vector<Voxel>(expected.begin(), expected.end()));
}

TEST(VoxelGrid, RandomDilationPicksPerVoxelBetweenTheNeighbouringRadii) {
  const std::vector<Voxel> voxels = scattered(5, 16, 2);
  for (const int radius : {0, 1, 2, 3}) {
    const std::vector<Voxel> small = radius <= 1 ? std::vector<Voxel>{} : dilate(voxels, 16, radius - 1);
    const std::vector<Voxel> large = dilate(voxels, 16, radius + 1);
    EXPECT_EQ(dilate_randomly(voxels, 16, radius, [] { return 0.0; }), small);
    EXPECT_EQ(dilate_randomly(voxels, 16, radius, [] { return 0.5; }), large);
    std::vector<Voxel> differing;
    std::set_difference(large.begin(), large.end(), small.begin(), small.end(), std::back_inserter(differing));
    std::size_t draws = 0;
    const std::vector<Voxel> mixed = dilate_randomly(voxels, 16, radius, [&] { return draws++ % 3 == 0 ? 0.9 : 0.1; });
    EXPECT_EQ(draws, differing.size());
    std::vector<Voxel> expected = small;
    for (std::size_t i = 0; i < differing.size(); i += 3) expected.push_back(differing[i]);
    sort_unique(expected);
    EXPECT_EQ(mixed, expected);
  }
}

TEST(VoxelGrid, PoolingMergesBlocks) {
  const std::vector<Voxel> voxels = {{5, 4, 3}, {0, 0, 0}, {1, 1, 1}, {4, 5, 2}, {0, 1, 0}};
  EXPECT_EQ(pool_voxels(voxels, 2), (std::vector<Voxel>{{0, 0, 0}, {2, 2, 1}}));
  const PooledVoxels pooled = pool_features(voxels, {10, 1, 20, 2, 30, 3, 40, 4, 50, 5}, 2, 2);
  EXPECT_EQ(pooled.voxels, (std::vector<Voxel>{{0, 0, 0}, {2, 2, 1}}));
  EXPECT_EQ(pooled.features, (std::vector<float>{25.0f, 2.5f, 50.0f / 3.0f, 5.0f / 3.0f}));
  EXPECT_EQ(pool_voxels(voxels, 1).size(), voxels.size());
  EXPECT_THROW(pool_voxels(voxels, 0), InputError);
  EXPECT_THROW(pool_features(voxels, {1, 2, 3}, 2, 2), InputError);
}

TEST(VoxelGrid, RefusesBadInput) {
  EXPECT_THROW(dilate({{0, 0, 64}}, 64, 1), InputError);
  EXPECT_THROW(dilate({{0, -1, 0}}, 64, 1), InputError);
  EXPECT_THROW(dilate({{0, 0, 0}}, 64, -1), InputError);
  EXPECT_THROW(dilate({{0, 0, 0}}, 0, 1), InputError);
  EXPECT_THROW(dilate({{0, 0, 0}}, 5000, 1), InputError);
  EXPECT_THROW(dilate_randomly({{9, 0, 0}}, 8, 1, [] { return 0.0; }), InputError);
  EXPECT_EQ(dilate({{0, 0, 0}}, 4, std::numeric_limits<int>::max()).size(), 64u);
  EXPECT_EQ(dilate_randomly({{0, 0, 0}}, 4, std::numeric_limits<int>::max(), [] { return 0.0; }).size(), 64u);
  try {
    dilate({{0, 0, 0}, {0, 0, 70}}, 64, 1);
    FAIL() << "a voxel outside the grid was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "voxels[1]");
  }
}

}  // namespace
}  // namespace anigen::geometry
