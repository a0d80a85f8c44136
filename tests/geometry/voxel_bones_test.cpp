#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/voxelize.h"

namespace anigen::geometry {
namespace {

using Lattice = std::array<std::int64_t, 3>;

/// num / den, den > 0.
struct Fraction {
  std::int64_t num, den;
};
bool less(const Fraction& a, const Fraction& b) { return a.num * b.den < b.num * a.den; }
bool equal(const Fraction& a, const Fraction& b) { return a.num * b.den == b.num * a.den; }

/// Whether the closed segment has a point with cell ≤ coordinate < cell + 1 along every axis, in exact fractions of its
/// length. Coordinates are in `steps` per voxel.
bool passes_through(const Lattice& a, const Lattice& b, const Voxel& voxel, std::int64_t steps) {
  Fraction from{0, 1}, to{1, 1};
  bool to_counts = true;  // whether the end of the interval belongs to it
  bool from_counts = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t low = voxel[axis] * steps, high = low + steps, length = b[axis] - a[axis];
    if (length == 0) {
      if (a[axis] < low || a[axis] >= high) return false;
      continue;
    }
    const std::int64_t size = std::abs(length), start = length > 0 ? low - a[axis] : a[axis] - high;
    const Fraction enter{start, size}, leave{start + steps, size};
    const bool enter_counts = length > 0, leave_counts = length < 0;
    if (less(from, enter)) {
      from = enter;
      from_counts = enter_counts;
    } else if (equal(from, enter)) {
      from_counts = from_counts && enter_counts;
    }
    if (less(leave, to)) {
      to = leave;
      to_counts = leave_counts;
    } else if (equal(to, leave)) {
      to_counts = to_counts && leave_counts;
    }
  }
  return less(from, to) || (equal(from, to) && from_counts && to_counts);
}

std::vector<Voxel> bone_voxels(const Eigen::Vector3d& a, const Eigen::Vector3d& b, int resolution) {
  return voxelize_bones({a, b}, {-1, 0}, resolution);
}

Eigen::Vector3d world(const Lattice& point, double steps, int resolution) {
  const Eigen::Vector3d grid =
      Eigen::Vector3d(static_cast<double>(point[0]), static_cast<double>(point[1]), static_cast<double>(point[2])) /
      steps;
  return grid.array() / resolution - 0.5;
}

TEST(VoxelizeBones, EqualsTheExactTestOfEveryVoxel) {
  // On coarse lattices bones run through edges and corners of voxels; on the fine one they do not.
  Rng rng(1, "bones");
  constexpr int kResolution = 8;
  for (const std::int64_t steps : {1, 2, 4, 4096}) {
    for (int i = 0; i < 300; ++i) {
      Lattice a{}, b{};
      // Not on the cube's surface, which is clipped.
      const auto count = static_cast<std::size_t>(kResolution * steps - 1);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        a[axis] = static_cast<std::int64_t>(rng.index(count)) + 1;
        b[axis] = rng.chance(0.2) ? a[axis] : static_cast<std::int64_t>(rng.index(count)) + 1;
      }
      std::vector<Voxel> expected;
      for (int v = 0; v < kResolution * kResolution * kResolution; ++v) {
        const Voxel voxel = {v / kResolution / kResolution, v / kResolution % kResolution, v % kResolution};
        if (passes_through(a, b, voxel, steps)) expected.push_back(voxel);
      }
      const Eigen::Vector3d from = world(a, static_cast<double>(steps), kResolution),
                            to = world(b, static_cast<double>(steps), kResolution);
      ASSERT_EQ(bone_voxels(from, to, kResolution), expected) << steps << " " << i;
      ASSERT_EQ(bone_voxels(to, from, kResolution), expected) << "backwards " << steps << " " << i;
    }
  }
}

TEST(VoxelizeBones, HoldsEverySampleAndStaysConnected) {
  Rng rng(2, "bones");
  for (const int resolution : {7, 64, 1000}) {
    for (int i = 0; i < 50; ++i) {
      const auto draw = [&] {
        return Eigen::Vector3d(rng.uniform(-0.49, 0.49), rng.uniform(-0.49, 0.49), rng.uniform(-0.49, 0.49));
      };
      const Eigen::Vector3d a = draw(), b = draw();
      const std::vector<Voxel> voxels = bone_voxels(a, b, resolution);
      const std::set<Voxel> set(voxels.begin(), voxels.end());
      for (int s = 0; s <= 4000; ++s) ASSERT_EQ(set.count(voxel_at(a + s / 4000.0 * (b - a), resolution)), 1u) << s;
      // From one face to the next: as many voxels as borders are crossed, plus one.
      const Voxel first = voxel_at(a, resolution), last = voxel_at(b, resolution);
      std::size_t crossings = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        crossings += static_cast<std::size_t>(std::abs(last[axis] - first[axis]));
      }
      EXPECT_EQ(voxels.size(), crossings + 1);
    }
  }
}

TEST(VoxelizeBones, ThroughCornersOfTheGridNoVoxelIsAddedBesides) {
  const Eigen::Vector3d a(-0.25, -0.25, -0.25), b(0.25, 0.25, 0.25);
  EXPECT_EQ(bone_voxels(a, b, 8),
            (std::vector<Voxel>{{2, 2, 2}, {3, 3, 3}, {4, 4, 4}, {5, 5, 5}, {6, 6, 6}}));  // 6: b lies on its corner
  // Down along y while x goes up: on the border both coordinates belong to the upper voxel.
  const Eigen::Vector3d c(-0.1875, 0.1875, 0), d(-0.0625, 0.0625, 0);
  EXPECT_EQ(bone_voxels(c, d, 8), (std::vector<Voxel>{{2, 5, 4}, {3, 4, 4}, {3, 5, 4}}));
}

TEST(VoxelizeBones, JointsOfAWholeSkeleton) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {0, 0, 0.3}, {0.2, 0, 0.3}, {0.2, 0, 0.3}, {-0.4, -0.4, 0}};
  const std::vector<Voxel> voxels = voxelize_bones(joints, {-1, 0, 1, 2, -1}, 64);
  const std::set<Voxel> set(voxels.begin(), voxels.end());
  for (const Eigen::Vector3d& joint : joints) EXPECT_EQ(set.count(voxel_at(joint, 64)), 1u);
  EXPECT_EQ(voxels.size(), (51 - 32 + 1) + (44 - 32) + 1u);  // 0.3 lies in voxel 51, 0.2 in voxel 44
  EXPECT_EQ(voxelize_bones({{0, 0, 0}}, {-1}, 64), (std::vector<Voxel>{{32, 32, 32}}));
}

TEST(VoxelizeBones, JointsOutsideTheCubeAreClipped) {
  EXPECT_EQ(bone_voxels({0, 0, 0.4}, {0, 0, 9}, 16), bone_voxels({0, 0, 0.4}, {0, 0, 0.4999}, 16));
  EXPECT_EQ(voxelize_bones({{-1e30, 0.5, 1e300}}, {-1}, 16), (std::vector<Voxel>{{0, 15, 15}}));
}

TEST(VoxelizeBones, RefusesBadInput) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {0, 0, 0.3}};
  EXPECT_THROW(voxelize_bones({}, {}, 64), InputError);
  EXPECT_THROW(voxelize_bones(joints, {-1}, 64), InputError);
  EXPECT_THROW(voxelize_bones(joints, {-1, 2}, 64), InputError);
  EXPECT_THROW(voxelize_bones(joints, {-1, -2}, 64), InputError);
  EXPECT_THROW(voxelize_bones(joints, {-1, 0}, 0), InputError);
  EXPECT_THROW(voxelize_bones(joints, {-1, 0}, 1 << 20), InputError);
  EXPECT_THROW(voxelize_bones({{0, 0, 0}, {0, std::nan(""), 0}}, {-1, 0}, 64), InputError);
}

}  // namespace
}  // namespace anigen::geometry
