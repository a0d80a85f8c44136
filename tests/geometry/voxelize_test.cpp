#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <set>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/geometry/voxel_brute_force.h"
#include "tests/support/paths.h"

namespace anigen::geometry {

namespace {

using Lattice = std::array<std::int64_t, 3>;

/// num / den, den > 0.
struct Fraction {
  std::int64_t num, den;
};
bool less(const Fraction& a, const Fraction& b) { return a.num * b.den < b.num * a.den; }
bool equal(const Fraction& a, const Fraction& b) { return a.num * b.den == b.num * a.den; }

/// True when the closed segment has a point with cell ≤ coordinate < cell + 1 along every axis, in exact fractions of
/// its length. Coordinates are in `steps` per voxel.
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
      for (std::size_t axis = 0; axis < 3; ++axis)
        crossings += static_cast<std::size_t>(std::abs(last[axis] - first[axis]));
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

namespace {

using test::GridTriangle;

/// Voxels: closer than this to touching, the rounding of the brute-force test decides.
constexpr double kTie = 1e-9;

std::vector<Voxel> voxelize(const GridTriangle& triangle, int resolution) {
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3d& corner : triangle) vertices.push_back(corner.array() / resolution - 0.5);
  return voxelize_surface(vertices, {{0, 1, 2}}, resolution, OutsideCube::kRefuse);
}

/// Every voxel of the grid, one by one.
std::vector<Voxel> brute_force(const GridTriangle& triangle, int resolution) {
  std::vector<Voxel> result;
  for (int x = 0; x < resolution; ++x) {
    for (int y = 0; y < resolution; ++y) {
      for (int z = 0; z < resolution; ++z) {
        if (test::separation(triangle, {x, y, z}, 0.0) <= 0.0) result.push_back({x, y, z});
      }
    }
  }
  return result;
}

GridTriangle random_triangle(Rng& rng, int resolution, double size) {
  const Eigen::Vector3d center(rng.uniform(0, resolution), rng.uniform(0, resolution), rng.uniform(0, resolution));
  GridTriangle triangle;
  for (Eigen::Vector3d& corner : triangle) {
    for (int axis = 0; axis < 3; ++axis) {
      const double low = std::max(0.0, center[axis] - size), high = std::min<double>(resolution, center[axis] + size);
      corner[axis] = rng.uniform(low, high);
    }
  }
  return triangle;
}

/// Corners on a coarse lattice: they lie on voxel faces, edges and corners, are often collinear or equal, and double
/// precision decides every test without rounding, so that touching is touching.
GridTriangle lattice_triangle(Rng& rng, int resolution, int steps_per_voxel) {
  GridTriangle triangle;
  const auto count = static_cast<std::size_t>(resolution * steps_per_voxel + 1);
  for (Eigen::Vector3d& corner : triangle) {
    for (int axis = 0; axis < 3; ++axis) corner[axis] = static_cast<double>(rng.index(count)) / steps_per_voxel;
  }
  return triangle;
}

TEST(VoxelizeSurface, EqualsSeparatingAxesOverTheWholeGrid) {
  Rng rng(1, "triangles");
  for (const double size : {0.3, 1.5, 5.0, 20.0}) {
    for (int i = 0; i < 150; ++i) {
      const GridTriangle triangle = random_triangle(rng, 16, size);
      ASSERT_EQ(voxelize(triangle, 16), brute_force(triangle, 16)) << size << " " << i;
    }
  }
}

TEST(VoxelizeSurface, TouchingCountsExactly) {
  Rng rng(2, "triangles");
  std::size_t touching = 0;
  for (const int steps : {1, 2, 4}) {
    for (int i = 0; i < 300; ++i) {
      const GridTriangle triangle = lattice_triangle(rng, 8, steps);
      ASSERT_EQ(voxelize(triangle, 8), brute_force(triangle, 8)) << steps << " " << i;
      test::for_candidates(
          triangle, 8, [&](const Voxel& voxel) { touching += test::separation(triangle, voxel, 0.0) == 0.0 ? 1 : 0; });
    }
  }
  EXPECT_GT(touching, 5000u);  // that the case is tested at all
}

TEST(VoxelizeSurface, TrianglesWithoutArea) {
  Rng rng(3, "triangles");
  for (int i = 0; i < 300; ++i) {
    GridTriangle triangle = lattice_triangle(rng, 8, 2);
    triangle[2] = i % 3 == 0 ? triangle[0] : 0.5 * (triangle[0] + triangle[1]);
    if (i % 7 == 0) triangle[1] = triangle[2] = triangle[0];
    ASSERT_EQ(voxelize(triangle, 8), brute_force(triangle, 8)) << i;
  }
}

TEST(VoxelizeSurface, KnownSets) {
  // A point inside a voxel, on a face between two, on a corner between eight.
  const Eigen::Vector3d inside(3.5, 3.5, 3.5), face(4.0, 3.5, 3.5), corner(4.0, 4.0, 4.0);
  EXPECT_EQ(voxelize({inside, inside, inside}, 8), (std::vector<Voxel>{{3, 3, 3}}));
  EXPECT_EQ(voxelize({face, face, face}, 8), (std::vector<Voxel>{{3, 3, 3}, {4, 3, 3}}));
  EXPECT_EQ(voxelize({corner, corner, corner}, 8).size(), 8u);
  // A square in a plane between two layers belongs to both.
  EXPECT_EQ(voxelize({Eigen::Vector3d(0.5, 0.5, 4), Eigen::Vector3d(7.5, 0.5, 4), Eigen::Vector3d(0.5, 7.5, 4)}, 8),
            brute_force({Eigen::Vector3d(0.5, 0.5, 4), Eigen::Vector3d(7.5, 0.5, 4), Eigen::Vector3d(0.5, 7.5, 4)}, 8));
  // The whole grid's corner, where there is nothing beyond.
  EXPECT_EQ(voxelize({Eigen::Vector3d(8, 8, 8), Eigen::Vector3d(8, 8, 8), Eigen::Vector3d(8, 8, 8)}, 8),
            (std::vector<Voxel>{{7, 7, 7}}));
}

TEST(VoxelizeSurface, TheOneVoxelGridAndTheLargest) {
  const std::vector<Eigen::Vector3d> vertices = {{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}, {0.5, -0.5, 0.1}};
  EXPECT_EQ(voxelize_surface(vertices, {{0, 1, 2}}, 1), (std::vector<Voxel>{{0, 0, 0}}));
  // Coordinates at the limit of the integer arithmetic, against every voxel near two places of the triangle.
  const std::vector<Voxel> large = voxelize_surface(vertices, {{0, 1, 2}}, 1024, OutsideCube::kRefuse);
  ASSERT_TRUE(std::is_sorted(large.begin(), large.end()));
  GridTriangle triangle;
  for (std::size_t k = 0; k < 3; ++k) triangle[k] = (vertices[k].array() + 0.5) * 1024;
  const Eigen::Vector3d middle = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
  std::size_t set_voxels = 0;
  for (const Eigen::Vector3d& place : {middle, Eigen::Vector3d(1012, 1012, 1012), Eigen::Vector3d(11, 11, 11)}) {
    for (int i = 0; i < 20 * 20 * 20; ++i) {
      const Voxel voxel = {static_cast<int>(place.x()) + i / 400 - 10, static_cast<int>(place.y()) + i / 20 % 20 - 10,
                           static_cast<int>(place.z()) + i % 20 - 10};
      const double gap = test::separation(triangle, voxel, kTie);
      const bool found = std::binary_search(large.begin(), large.end(), voxel);
      set_voxels += found ? 1 : 0;
      if (std::abs(gap) > kTie) {
        ASSERT_EQ(found, gap < 0.0) << i;
      }
    }
  }
  EXPECT_GT(set_voxels, 500u);
}

Mesh soup(std::size_t faces, std::uint64_t seed) {
  Rng rng(seed, "soup");
  Mesh mesh;
  for (std::size_t f = 0; f < faces; ++f) {
    const GridTriangle triangle = random_triangle(rng, 64, f % 10 == 0 ? 40.0 : 2.0);
    for (const Eigen::Vector3d& corner : triangle)
      mesh.vertices.push_back((corner.array() / 64 - 0.5).matrix().cast<float>());
    const auto first = static_cast<std::int32_t>(3 * f);
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

TEST(VoxelizeSurface, SameResultsOnAnyNumberOfThreads) {
  const Mesh mesh = soup(3000, 4);
  const int before = thread_count();
  set_thread_count(1);
  const std::vector<Voxel> one = voxelize_surface(mesh.vertices, mesh.faces, 64);
  set_thread_count(4);
  const std::vector<Voxel> four = voxelize_surface(mesh.vertices, mesh.faces, 64);
  set_thread_count(before);
  EXPECT_EQ(one, four);
  EXPECT_GT(one.size(), 10000u);
}

TEST(VoxelizeSurface, EveryPointOfTheSurfaceIsCovered) {
  const Mesh mesh = soup(200, 5);
  const std::vector<Voxel> voxels = voxelize_surface(mesh.vertices, mesh.faces, 100);
  const std::set<Voxel> set(voxels.begin(), voxels.end());
  Rng rng(6, "points");
  for (const Triangle& face : mesh.faces) {
    for (int i = 0; i < 50; ++i) {
      const double root = std::sqrt(rng.uniform()), v = rng.uniform();
      const auto corner = [&](std::size_t k) {
        const double edge = 0.5 - 1e-6;
        const Eigen::Vector3d vertex = mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>();
        return Eigen::Vector3d(vertex.cwiseMax(-edge).cwiseMin(edge));
      };
      const Eigen::Vector3d point = (1.0 - root) * corner(0) + root * (1.0 - v) * corner(1) + root * v * corner(2);
      ASSERT_EQ(set.count(voxel_at(point, 100)), 1u);
    }
  }
}

TEST(VoxelizeSurface, OutsideVerticesAreClippedOrRefused) {
  const std::vector<Eigen::Vector3d> beyond = {{0, 0, 0}, {7, 0, 0}, {0, -1e30, 0}};
  const std::vector<Eigen::Vector3d> clipped = {{0, 0, 0}, {0.5 - 1e-6, 0, 0}, {0, -0.5 + 1e-6, 0}};
  EXPECT_EQ(voxelize_surface(beyond, {{0, 1, 2}}, 16), voxelize_surface(clipped, {{0, 1, 2}}, 16));
  try {
    voxelize_surface(beyond, {{0, 1, 2}}, 16, OutsideCube::kRefuse);
    FAIL() << "a vertex outside the cube was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "mesh.vertices[1]");
  }
}

TEST(VoxelizeSurface, RefusesBadInput) {
  const std::vector<Eigen::Vector3f> good = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}};
  const std::vector<Triangle> face = {{0, 1, 2}};
  EXPECT_THROW(voxelize_surface(good, face, 0), InputError);
  EXPECT_THROW(voxelize_surface(good, face, -64), InputError);
  EXPECT_THROW(voxelize_surface(good, face, kMaxVoxelResolution + 1), InputError);
  EXPECT_THROW(voxelize_surface(good, face, std::numeric_limits<int>::max()), InputError);
  EXPECT_THROW(voxelize_surface(good, {}, 64), InputError);
  EXPECT_THROW(voxelize_surface(good, {{0, 1, 3}}, 64), InputError);
  EXPECT_THROW(voxelize_surface(good, {{0, -1, 2}}, 64), InputError);
  for (const float bad : {std::nanf(""), INFINITY, -INFINITY}) {
    auto vertices = good;
    vertices[1].y() = bad;
    try {
      voxelize_surface(vertices, face, 64);
      FAIL() << "a vertex that is not finite was accepted";
    } catch (const InputError& error) {
      EXPECT_EQ(error.place(), "mesh.vertices[1]");
    }
  }
}

// Every face of every real mesh against the separating-axis test of every voxel near it.
TEST(VoxelizeSurface, RealMeshesHaveNoDifferences) {
  const auto folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real meshes at " << folder;
  constexpr int kResolution = 64;
  std::size_t meshes = 0, ties = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".glb" && entry.path().extension() != ".gltf") continue;
    Asset asset = io::read_gltf(entry.path()).asset;
    normalize(asset);
    const std::vector<Voxel> voxels = voxelize_surface(asset.mesh.vertices, asset.mesh.faces, kResolution);
    std::map<Voxel, double> gaps;  // the deepest overlap, or the smallest gap, with any face
    for (const Triangle& face : asset.mesh.faces) {
      const GridTriangle triangle = test::grid_triangle(asset.mesh.vertices, face, kResolution);
      test::for_candidates(triangle, kResolution, [&](const Voxel& voxel) {
        const auto known = gaps.find(voxel);
        if (known != gaps.end() && known->second < -kTie) return;  // nothing a further face could change
        const double gap = test::separation(triangle, voxel, kTie);
        if (known == gaps.end() || gap < known->second) gaps[voxel] = gap;
      });
    }
    const std::set<Voxel> set(voxels.begin(), voxels.end());
    std::size_t missing = 0, extra = 0, mesh_ties = 0;
    for (const auto& [voxel, gap] : gaps) {
      const bool found = set.count(voxel) != 0;
      if (std::abs(gap) <= kTie) {
        ++mesh_ties;
      } else if (found != (gap < 0.0)) {
        ++(found ? extra : missing);
      }
    }
    for (const Voxel& voxel : voxels) extra += gaps.count(voxel) == 0 ? 1 : 0;
    EXPECT_EQ(missing, 0u) << entry.path();
    EXPECT_EQ(extra, 0u) << entry.path();
    ++meshes;
    ties += mesh_ties;
  }
  std::printf("%zu meshes, %zu voxels that a face only touches\n", meshes, ties);
  EXPECT_GT(meshes, 0u);
}

}  // namespace

}  // namespace anigen::geometry
