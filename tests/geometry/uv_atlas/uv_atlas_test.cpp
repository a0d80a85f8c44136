#include "anigen/geometry/uv_atlas/uv_atlas.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/uv_atlas/packing.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/geometry/uv_atlas/surface_zoo.h"
#include "tests/support/paths.h"

namespace anigen::geometry {
namespace {

UvAtlasOptions sized(int size) {
  UvAtlasOptions options;
  options.size = size;
  return options;
}

/// A face in the texture, in texels, y upwards, in double precision.
std::array<Eigen::Vector2d, 3> flat_face(const UvAtlas& atlas, std::size_t face) {
  std::array<Eigen::Vector2d, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2d uv = atlas.uvs[at(atlas.faces[face][k])].cast<double>();
    corners[k] = atlas.size * Eigen::Vector2d(uv.x(), 1.0 - uv.y());
  }
  return corners;
}

double flat_area(const std::array<Eigen::Vector2d, 3>& c) {
  const Eigen::Vector2d ab = c[1] - c[0], ac = c[2] - c[0];
  return 0.5 * (ab.x() * ac.y() - ab.y() * ac.x());
}

struct SpaceFace {
  explicit SpaceFace(const Mesh& mesh, std::size_t face) {
    for (std::size_t k = 0; k < 3; ++k) corners[k] = mesh.vertices[at(mesh.faces[face][k])].cast<double>();
    area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).norm();
    for (std::size_t k = 0; k < 3; ++k) longest = std::max(longest, (corners[(k + 1) % 3] - corners[k]).norm());
  }
  /// Its least height: what a sliver lacks.
  double height() const { return longest > 0.0 ? 2.0 * area / longest : 0.0; }

  std::array<Eigen::Vector3d, 3> corners;
  double area = 0.0, longest = 0.0;
};

/// Coordinates in float are good to about 1e-4 texels: below this height a face may come out without area or mirrored.
constexpr double kSliverTexels = 2e-3;

/// Every face of the mesh is there once, with the same corners, in its order; coordinates lie in the unit square.
void expect_same_faces(const Mesh& mesh, const UvAtlas& atlas) {
  ASSERT_EQ(atlas.faces.size(), mesh.faces.size());
  ASSERT_EQ(atlas.uvs.size(), atlas.vertices.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) ASSERT_EQ(atlas.vertices[at(atlas.faces[f][k])], mesh.faces[f][k]) << f;
    ASSERT_GE(atlas.face_charts[f], 0);
    ASSERT_LT(at(atlas.face_charts[f]), atlas.charts.size());
  }
  for (const Eigen::Vector2f& uv : atlas.uvs) {
    ASSERT_GE(uv.minCoeff(), 0.0F);
    ASSERT_LE(uv.maxCoeff(), 1.0F);
  }
}

/// Faces are not mirrored, lengths are neither stretched nor shrunk by more than the option allows.
void expect_bounded_stretch(const Mesh& mesh, const UvAtlas& atlas, double max_deviation) {
  const double least = std::cos(max_deviation * kPi / 180.0);
  EXPECT_LE(atlas.stretch, 1.0 / least + 1e-6);
  std::size_t mirrored = 0, distorted = 0;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const SpaceFace face(mesh, f);
    const double height = face.height() * atlas.texels_per_unit;
    if (height < kSliverTexels) continue;
    const auto flat = flat_face(atlas, f);
    mirrored += flat_area(flat) > 0.0 ? 0 : 1;
    // The area shrinks by the cosine of the angle between face and plane.
    const double cosine = flat_area(flat) / (face.area * atlas.texels_per_unit * atlas.texels_per_unit);
    const double rounding = 1e-3 / height;
    distorted += cosine > least - rounding && cosine < 1.0 + rounding ? 0 : 1;
  }
  EXPECT_EQ(mirrored, 0U);
  EXPECT_EQ(distorted, 0U);
}

/// No texel's centre is less than a texel away from two charts, nor inside two faces. @param overlaps_allowed of faces
/// of one chart: thinner than the distance of centres
void expect_separate_texels(const UvAtlas& atlas, std::size_t overlaps_allowed) {
  const std::size_t texels = at(atlas.size) * at(atlas.size);
  std::vector<std::int32_t> chart(texels, -1);
  std::vector<int> inside(texels, 0);
  std::size_t shared = 0, overlapping = 0;
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    const auto c = flat_face(atlas, f);
    const Eigen::Vector2d low = c[0].cwiseMin(c[1]).cwiseMin(c[2]), high = c[0].cwiseMax(c[1]).cwiseMax(c[2]);
    const double area = flat_area(c);
    for (int y = static_cast<int>(low.y()) - 2; y <= static_cast<int>(high.y()) + 2; ++y) {
      for (int x = static_cast<int>(low.x()) - 2; x <= static_cast<int>(high.x()) + 2; ++x) {
        if (x < 0 || y < 0 || x >= atlas.size || y >= atlas.size) continue;
        const std::size_t texel = at(y) * at(atlas.size) + at(x);
        const Eigen::Vector3d centre(x + 0.5, y + 0.5, 0.0);
        const auto corner = [&](std::size_t k) { return Eigen::Vector3d(c[k].x(), c[k].y(), 0.0); };
        const NearestPoint nearest = nearest_on_triangle(centre, corner(0), corner(1), corner(2));
        if (nearest.distance < 0.99) {
          if (chart[texel] >= 0 && chart[texel] != atlas.face_charts[f]) ++shared;
          chart[texel] = atlas.face_charts[f];
        }
        // Well inside: not where an edge that two faces share passes through the centre.
        const double reach = std::max((high - low).maxCoeff(), 1e-9);
        if (nearest.distance == 0.0 && nearest.at.barycentric.minCoeff() * 2.0 * std::abs(area) / reach > 1e-3) {
          if (++inside[texel] == 2) ++overlapping;
        }
      }
    }
  }
  EXPECT_EQ(shared, 0U) << "texels near two charts";
  EXPECT_LE(overlapping, overlaps_allowed) << "texels inside two faces";
}

UvAtlas sound_atlas(const char* name, const Mesh& mesh, const UvAtlasOptions& options, std::size_t overlaps = 0) {
  const auto begin = std::chrono::steady_clock::now();
  UvAtlas atlas = make_uv_atlas(mesh.vertices, mesh.faces, options);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  std::printf("%-28s %6zu faces %5zu charts, %4d²: occupancy %.3f, stretch %.3f, %.2f s\n", name, mesh.faces.size(),
              atlas.charts.size(), atlas.size, atlas.occupancy, atlas.stretch, seconds.count());
  expect_same_faces(mesh, atlas);
  expect_bounded_stretch(mesh, atlas, options.max_deviation);
  expect_separate_texels(atlas, overlaps);
  return atlas;
}

TEST(UvAtlas, CubeIsSixSquares) {
  const UvAtlas atlas = sound_atlas("cube", test::unit_cube(), sized(256));
  EXPECT_EQ(atlas.charts.size(), 6U);
  EXPECT_EQ(atlas.vertices.size(), 24U);
  EXPECT_NEAR(atlas.stretch, 1.0, 1e-9);
  EXPECT_GT(atlas.occupancy, 0.55);  // three by three squares, six of them used, without gutters: 0.667
}

TEST(UvAtlas, RoundSurfacesNeedFewCharts) {
  for (const int size : {128, 1024}) {
    const UvAtlas sphere = sound_atlas("sphere", test::round_sphere(0.5, 50, 100), sized(size));
    EXPECT_LE(sphere.charts.size(), 40U);  // one has 0.117 of the sphere at most
    const UvAtlas ring = sound_atlas("torus", test::torus(0.35, 0.13, 120, 60), sized(size));
    EXPECT_LE(ring.charts.size(), 100U);
    for (const UvAtlas* atlas : {&sphere, &ring}) EXPECT_GT(atlas->occupancy, size == 1024 ? 0.55 : 0.35);
  }
}

TEST(UvAtlas, LessDeviationMeansLessStretch) {
  const Mesh sphere = test::round_sphere(0.5, 40, 80);
  for (const double deviation : {20.0, 35.0, 70.0}) {
    UvAtlasOptions options = sized(256);
    options.max_deviation = deviation;
    sound_atlas("sphere", sphere, options);
  }
}

TEST(UvAtlas, ChartsThatCoverThemselvesAreSplit) {
  const Mesh ramp = test::spiral_ramp(4, 40);
  const UvAtlas atlas = sound_atlas("spiral ramp", ramp, sized(512));
  EXPECT_GE(atlas.charts.size(), 4U);
  // One face twice: only one of them can have the place.
  Mesh twice = test::unit_cube();
  twice.faces.push_back(twice.faces[0]);
  EXPECT_EQ(sound_atlas("cube, a face twice", twice, sized(128)).charts.size(), 7U);
}

TEST(UvAtlas, LongThinMeshesFillTheTexture) {
  // A rod of one by a fiftieth: a single chart from end to end would leave nine tenths of the texture empty.
  Mesh rod;
  constexpr int kRings = 200, kSides = 12;
  for (int r = 0; r <= kRings; ++r) {
    for (int s = 0; s < kSides; ++s) {
      const double angle = 2.0 * kPi * s / kSides;
      rod.vertices.push_back(
          Eigen::Vector3d(double(r) / kRings - 0.5, 0.01 * std::cos(angle), 0.01 * std::sin(angle)).cast<float>());
    }
  }
  for (int r = 0; r < kRings; ++r) {
    for (int s = 0; s < kSides; ++s) {
      const int a = r * kSides + s, b = r * kSides + (s + 1) % kSides;
      rod.faces.push_back({a, b, b + kSides});
      rod.faces.push_back({a, b + kSides, a + kSides});
    }
  }
  EXPECT_GT(sound_atlas("rod", rod, sized(512)).occupancy, 0.4);
}

TEST(UvAtlas, SplitVerticesDoNotMakeCharts) {
  const Mesh sphere = test::round_sphere(0.5, 20, 40);
  const UvAtlas whole = make_uv_atlas(sphere.vertices, sphere.faces, sized(256));
  const Mesh apart = test::unwelded(sphere);
  const UvAtlas split = sound_atlas("sphere, unwelded", apart, sized(256));
  EXPECT_EQ(split.charts.size(), whole.charts.size());
  EXPECT_EQ(split.vertices.size(), apart.vertices.size());
}

TEST(UvAtlas, FacesWithoutAreaAndUnusedVerticesAreHarmless) {
  Mesh mesh = test::unit_cube();
  mesh.vertices.emplace_back(0.5F, 0.5F, 0.5F);  // 8: where 7 is
  mesh.vertices.emplace_back(9.0F, 9.0F, 9.0F);  // 9: unused
  mesh.vertices.emplace_back(0.0F, 0.5F, 0.5F);  // 10: on an edge
  for (const Triangle& flat : {Triangle{7, 8, 3}, Triangle{1, 1, 1}, Triangle{7, 10, 6}}) mesh.faces.push_back(flat);
  const UvAtlas atlas = sound_atlas("cube, flat faces", mesh, sized(128));
  EXPECT_EQ(std::count(atlas.vertices.begin(), atlas.vertices.end(), 9), 0);
}

TEST(UvAtlas, ResultDoesNotDependOnThreads) {
  const Mesh mesh = test::torus(0.35, 0.13, 40, 30);
  const int before = thread_count();
  set_thread_count(1);
  const UvAtlas one = make_uv_atlas(mesh.vertices, mesh.faces, sized(256));
  set_thread_count(4);
  const UvAtlas four = make_uv_atlas(mesh.vertices, mesh.faces, sized(256));
  set_thread_count(before);
  EXPECT_EQ(one.vertices, four.vertices);
  EXPECT_EQ(one.faces, four.faces);
  EXPECT_TRUE(one.uvs == four.uvs);
}

TEST(UvAtlas, ChartPlanesSayWhereATexelGoes) {
  const Mesh mesh = test::torus(0.35, 0.13, 40, 30);
  const UvAtlas atlas = make_uv_atlas(mesh.vertices, mesh.faces, sized(256));
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const AtlasChart& chart = atlas.charts[at(atlas.face_charts[f])];
    const Eigen::Vector3d normal = chart.down.cross(chart.right).normalized();
    const SpaceFace face(mesh, f);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      const Eigen::Vector2f from = atlas.uvs[at(atlas.faces[f][k])], to = atlas.uvs[at(atlas.faces[f][next])];
      const Eigen::Vector2d texels = atlas.size * (to - from).cast<double>();
      Eigen::Vector3d along = face.corners[next] - face.corners[k];
      along -= normal.dot(along) * normal;
      ASSERT_LT((texels.x() * chart.right + texels.y() * chart.down - along).norm(), 1e-5);
    }
  }
}

TEST(UvAtlas, EveryRealMeshUnwraps) {
  const auto folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "no real meshes at " << folder;
  }
  std::set<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf") files.insert(entry.path());
  }
  ASSERT_FALSE(files.empty());
  double occupancy = 0.0;
  for (const auto& file : files) {
    SCOPED_TRACE(file.filename().string());
    Asset asset = io::read_gltf(file).asset;
    normalize(asset);
    // A thousandth of the texels: those that show overlaps narrower than what counts.
    occupancy += sound_atlas(file.stem().c_str(), asset.mesh, sized(256), 256 * 256 / 1000).occupancy;
  }
  std::printf("mean occupancy of %zu meshes: %.3f\n", files.size(), occupancy / static_cast<double>(files.size()));
  EXPECT_GT(occupancy / static_cast<double>(files.size()), 0.5);
}

std::string refused_place(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.place();
  }
  return "nothing";
}

TEST(UvAtlas, RefusesBadInput) {
  const Mesh cube = test::unit_cube();
  const auto refused = [](const Mesh& mesh, const UvAtlasOptions& options) {
    return refused_place([&] { make_uv_atlas(mesh.vertices, mesh.faces, options); });
  };
  EXPECT_EQ(refused(cube, sized(8)), "size");
  EXPECT_EQ(refused(cube, sized(10000)), "size");
  UvAtlasOptions wide = sized(64);
  wide.gutter = 17;
  EXPECT_EQ(refused(cube, wide), "gutter");
  wide.gutter = 0;
  EXPECT_EQ(refused(cube, wide), "gutter");
  UvAtlasOptions steep = sized(64);
  steep.max_deviation = 90.0;
  EXPECT_EQ(refused(cube, steep), "max_deviation");
  steep.max_deviation = std::nan("");
  EXPECT_EQ(refused(cube, steep), "max_deviation");
  Mesh broken = cube;
  broken.faces[2][1] = 8;
  EXPECT_NE(refused(broken, sized(64)), "nothing");
  broken = cube;
  broken.vertices[3].y() = std::nanf("");
  EXPECT_NE(refused(broken, sized(64)), "nothing");
  broken = cube;
  broken.faces.clear();
  EXPECT_EQ(refused(broken, sized(64)), "mesh.faces");
  broken.faces = {{1, 1, 2}};
  EXPECT_EQ(refused(broken, sized(64)), "mesh.faces");
  // A thousand loose triangles have no room among 256 texels.
  Mesh crowd;
  Rng rng(1, "crowd");
  for (int i = 0; i < 3000; ++i) crowd.vertices.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
  for (std::int32_t i = 0; i < 1000; ++i) crowd.faces.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  EXPECT_EQ(refused(crowd, sized(16)), "size");
  sound_atlas("loose triangles", crowd, sized(512));
}

TEST(TexelCentres, NeighboursShareNoneAndLeaveNoneOut) {
  // A square cut into triangles around random inner points: each centre inside belongs to exactly one of them.
  Rng rng(2, "fans");
  for (int round = 0; round < 50; ++round) {
    // Corners on centres, edges through centres: the hard case.
    const double low = round % 2 == 0 ? 0.5 : rng.uniform(0.0, 2.0),
                 high = round % 2 == 0 ? 12.5 : rng.uniform(9.0, 13.0);
    const Eigen::Vector2d corners[4] = {{low, low}, {high, low}, {high, high}, {low, high}};
    const Eigen::Vector2d middle =
        round % 4 == 0 ? Eigen::Vector2d(6.5, 6.5) : Eigen::Vector2d(rng.uniform(low, high), rng.uniform(low, high));
    std::vector<int> count(14 * 14, 0);
    for (int k = 0; k < 4; ++k) {
      for_each_texel_centre(corners[k], middle, corners[(k + 1) % 4], 14, 14,
                            [&](int x, int y) { ++count[at(y * 14 + x)]; });
    }
    for (int y = 0; y < 14; ++y) {
      for (int x = 0; x < 14; ++x) {
        const bool inside = x + 0.5 >= low && x + 0.5 < high && y + 0.5 >= low && y + 0.5 < high;
        ASSERT_EQ(count[at(y * 14 + x)], inside ? 1 : 0) << round << ": " << x << ", " << y;
      }
    }
  }
}

TEST(TexelRows, AgreeWithAPlainTable) {
  Rng rng(3, "rows");
  constexpr int kWidth = 150, kRows = 5;
  TexelRows rows(kWidth);
  std::vector<std::vector<bool>> plain(kRows, std::vector<bool>(kWidth, false));
  for (int round = 0; round < 400; ++round) {
    const int row = static_cast<int>(rng.index(kRows));
    int begin = static_cast<int>(rng.index(kWidth + 20)) - 10, end = begin + static_cast<int>(rng.index(6));
    rows.take(row, begin, end);
    for (int x = std::max(begin, 0); x < std::min(end, kWidth); ++x) plain[at(row)][at(x)] = true;
    begin = static_cast<int>(rng.index(kWidth));
    end = begin + static_cast<int>(rng.index(kWidth - at(begin) + 1));
    int last = -1, free = begin;
    for (int x = begin; x < end; ++x) last = plain[at(row)][at(x)] ? x : last;
    while (free < kWidth && plain[at(row)][at(free)]) ++free;
    ASSERT_EQ(rows.last_taken(row, begin, end), last) << begin << " to " << end;
    ASSERT_EQ(rows.first_free(row, begin), free) << begin;
    int taken = begin, longest = 0, run = 0;
    while (taken < kWidth && !plain[at(row)][at(taken)]) ++taken;
    ASSERT_EQ(rows.first_taken(row, begin), taken) << begin;
    for (int x = 0; x < kWidth; ++x) longest = std::max(longest, run = plain[at(row)][at(x)] ? 0 : run + 1);
    ASSERT_EQ(rows.longest_free(row), longest);
  }
  EXPECT_EQ(rows.last_taken(kRows + 3, 0, kWidth), -1);
  EXPECT_EQ(rows.first_free(kRows + 3, 7), 7);
  EXPECT_EQ(rows.longest_free(kRows + 3), kWidth);
}

TEST(ChartMask, HoldsEveryTexelThatTheChartTouches) {
  Rng rng(4, "masks");
  for (int round = 0; round < 40; ++round) {
    std::vector<Eigen::Vector3f> vertices;
    for (int k = 0; k < 4; ++k) vertices.emplace_back(rng.uniform(0, 1), rng.uniform(0, 1), 0.0F);
    const std::vector<Triangle> faces = {{0, 1, 2}, {1, 3, 2}};
    const PlanarChart flat = planar_chart({{0, 1}, Eigen::Vector3d::UnitZ()}, vertices, faces);
    const double scale = rng.uniform(0.5, 30.0);
    for (int turns = 0; turns < 4; ++turns) {
      const ChartMask mask(flat, scale, turns);
      for (int i = 0; i < 2000; ++i) {
        const Triangle& t = flat.triangles[rng.index(2)];
        double u = rng.uniform(), v = rng.uniform();
        if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
        const Eigen::Vector2d point =
            (1.0 - u - v) * flat.points[at(t[0])] + u * flat.points[at(t[1])] + v * flat.points[at(t[2])];
        const Eigen::Vector2d texel = texel_place(flat, point, scale, turns);
        const int x = static_cast<int>(texel.x()), y = static_cast<int>(texel.y());
        ASSERT_TRUE(x >= 0 && x < mask.width && y >= 0 && y < mask.height);
        ASSERT_TRUE(std::any_of(mask.begin(y), mask.end(y),
                                [&](const ChartMask::Run& run) { return run.begin <= x && x < run.end; }))
            << round << ": " << texel.transpose();
      }
      // And no others: all of them lie within a texel's diagonal around the triangles.
      int held = 0;
      for (const ChartMask::Run& run : mask.runs) held += run.end - run.begin;
      double room = 0.0;
      for (const Triangle& t : flat.triangles) {
        const Eigen::Vector2d a = scale * flat.points[at(t[0])], b = scale * flat.points[at(t[1])];
        const Eigen::Vector2d c = scale * flat.points[at(t[2])];
        const double perimeter = (b - a).norm() + (c - b).norm() + (a - c).norm();
        room += std::abs(flat_area({a, b, c})) + std::sqrt(2.0) * perimeter + 2.0 * kPi;
      }
      EXPECT_LE(held, room);
    }
  }
}

}  // namespace
}  // namespace anigen::geometry
