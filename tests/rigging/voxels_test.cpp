#include <gtest/gtest.h>

#include <limits>
#include <queue>

#include "anigen/core/random.h"
#include "anigen/geometry/primitives.h"
#include "anigen/rigging/voxels.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::rigging {
namespace {

using namespace anigen::test;

/// The solid of a body with a joint in the middle of everything.
SolidVoxels solid_of(const Mesh& mesh, int resolution, const std::vector<Eigen::Vector3d>& joints = {{0, 0, 0}},
                     bool validate = true) {
  const WeldedSurface surface = weld_surface(mesh);
  const std::vector<int> parents(joints.size(), -1);
  return solid_voxels(surface, moving_bones(skeleton_from_joints(joints, parents), surface), resolution, validate);
}

/// State of the cell that holds a point of the unit frame.
int state_at(const SolidVoxels& solid, const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = solid.block.measured(point);
  return solid.states[solid.block.index(static_cast<int>(p.x()), static_cast<int>(p.y()), static_cast<int>(p.z()))];
}

/// Cells inside or on a ball around the origin of the unit frame, against what its volume says.
void expect_ball(const SolidVoxels& solid, double radius) {
  for (std::size_t cell = 0; cell < solid.states.size(); ++cell) {
    const std::array<int, 3> c = solid.block.cell(cell);
    Eigen::Vector3d p;
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      p[axis] = (c[k] + 0.5 + solid.block.low[k] - 0.5 * solid.block.resolution) / solid.block.cells_per_unit;
    }
    const double margin = 1.5 / solid.block.cells_per_unit;
    if (p.norm() < radius - margin) {
      ASSERT_EQ(solid.states[cell], SolidVoxels::kInside) << p.transpose();
    }
    if (p.norm() > radius + margin) {
      ASSERT_EQ(solid.states[cell], SolidVoxels::kOutside) << p.transpose();
    }
  }
}

Mesh without(const Mesh& mesh, const std::function<bool(const Eigen::Vector3f&)>& gone) {
  Mesh result = mesh;
  result.faces.clear();
  for (const Triangle& face : mesh.faces) {
    if (!gone(mesh.vertices[at(face[0])])) result.faces.push_back(face);
  }
  return result;
}

void append_mesh(Mesh& mesh, const Mesh& other, const Eigen::Vector3f& offset = Eigen::Vector3f::Zero()) {
  const auto base = static_cast<std::int32_t>(mesh.vertices.size());
  for (const Eigen::Vector3f& p : other.vertices) mesh.vertices.push_back(p + offset);
  for (const Triangle& face : other.faces) mesh.faces.push_back({base + face[0], base + face[1], base + face[2]});
}

TEST(SolidVoxels, FillASphere) {
  for (const int resolution : {31, 64}) expect_ball(solid_of(geometry::icosphere(4, 3.0), resolution), 0.5);
}

TEST(SolidVoxels, FillASphereWithHolesWoundBothWays) {
  Mesh mesh = without(geometry::icosphere(4, 3.0), [](const Eigen::Vector3f& p) { return p.x() > 2.7F; });
  for (std::size_t f = 0; f < mesh.faces.size(); f += 3) std::swap(mesh.faces[f][0], mesh.faces[f][1]);
  const SolidVoxels solid = solid_of(mesh, 64);
  // The hole is not closed, but everything in front of which there is surface on most sides is full.
  EXPECT_EQ(state_at(solid, {0, 0, 0}), SolidVoxels::kInside);
  for (const double x : {-0.4, -0.2, 0.0, 0.2, 0.4}) EXPECT_EQ(state_at(solid, {x, 0.05, 0.03}), SolidVoxels::kInside);
  EXPECT_EQ(state_at(solid, {0.49, 0.45, 0.0}), SolidVoxels::kOutside);
}

TEST(SolidVoxels, FillWhatLiesInSeveralPartsAndOnFacesTwice) {
  Mesh mesh = geometry::icosphere(4, 3.0);
  Mesh inverted = mesh;
  for (Triangle& face : inverted.faces) std::swap(face[0], face[1]);
  append_mesh(mesh, inverted);                     // both sides of every face
  append_mesh(mesh, geometry::icosphere(3, 1.0));  // a part inside
  append_mesh(mesh, geometry::icosphere(3, 1.0), {1.0F, 0.0F, 0.0F});
  expect_ball(
      [&] {
        SolidVoxels solid = solid_of(mesh, 64, {{0, 0, 0}, {1.5, 0, 0}, {2.5, 0, 0}, {0.5, 0, 0}});
        for (std::uint8_t& state : solid.states) {  // walls within are as good as inside
          if (state == SolidVoxels::kWall) state = SolidVoxels::kInside;
        }
        return solid;
      }(),
      0.5);
}

TEST(SolidVoxels, LeaveACupEmptyUnlessABoneIsInIt) {
  // A box without its top: five of six rays are odd in it.
  Mesh box;
  append_box(box, {-1, -1, -1}, {1, 1, 1}, 8);
  const Mesh cup = without(box, [](const Eigen::Vector3f& p) { return p.z() > 0.99F; });
  EXPECT_EQ(state_at(solid_of(cup, 32, {{0, 0, 0}}), {0.3, 0.3, 0.0}), SolidVoxels::kInside);
  EXPECT_EQ(state_at(solid_of(cup, 32, {{0, 0, 5}}), {0.3, 0.3, 0.0}), SolidVoxels::kOutside);
  EXPECT_EQ(state_at(solid_of(cup, 32, {{0, 0, 5}}, false), {0.3, 0.3, 0.0}), SolidVoxels::kInside);
}

TEST(SolidVoxels, DoNotFillBetweenFingersOrBehindASheet) {
  Mesh mesh;
  append_box(mesh, {0, 0, 0}, {1, 1, 4}, 2);
  append_box(mesh, {2, 0, 0}, {3, 1, 4}, 2);
  append_box(mesh, {0, 0, -1}, {3, 1, 0.1}, 2);
  const SolidVoxels solid = solid_of(mesh, 64, {{0.5, 0.5, 2}, {2.5, 0.5, 2}, {1.5, 0.5, -0.5}});
  EXPECT_EQ(state_at(solid, {0.0, 0.0, 0.1}), SolidVoxels::kOutside);
  EXPECT_EQ(state_at(solid, {-0.2, 0.0, 0.1}), SolidVoxels::kInside);
  Mesh sheet;
  sheet.vertices = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  sheet.faces = {{0, 1, 2}, {0, 2, 3}};
  const SolidVoxels flat = solid_of(sheet, 16);
  EXPECT_EQ(std::count(flat.states.begin(), flat.states.end(), SolidVoxels::kInside), 0);
  EXPECT_EQ(static_cast<std::size_t>(std::count(flat.states.begin(), flat.states.end(), SolidVoxels::kWall)),
            flat.walls.size());
}

/// By the textbook: a heap and no bounds.
std::vector<float> dijkstra(const SolidVoxels& solid, const std::vector<PathSource>& sources) {
  std::vector<float> distances(solid.states.size(), std::numeric_limits<float>::infinity());
  std::priority_queue<std::pair<float, std::uint32_t>, std::vector<std::pair<float, std::uint32_t>>, std::greater<>>
      heap;
  for (const PathSource& source : sources) heap.emplace(source.distance, source.cell);
  while (!heap.empty()) {
    const auto [distance, cell] = heap.top();
    heap.pop();
    if (!(distance < distances[cell])) continue;
    distances[cell] = distance;
    const std::array<int, 3> c = solid.block.cell(cell);
    for (int n = 0; n < 27; ++n) {
      const int dx = n / 9 - 1, dy = n / 3 % 3 - 1, dz = n % 3 - 1;
      const std::size_t next = solid.block.index(c[0] + dx, c[1] + dy, c[2] + dz);
      if (n == 13 || !solid.is_solid(next)) continue;
      heap.emplace(distance + std::sqrt(static_cast<float>(dx * dx + dy * dy + dz * dz)), next);
    }
  }
  return distances;
}

/// Crooked: half of the cells of a ball at random.
SolidVoxels sponge() {
  SolidVoxels solid = solid_of(geometry::icosphere(3, 1.0), 24);
  Rng rng(3, "sponge");
  for (std::uint8_t& state : solid.states) {
    if (state != SolidVoxels::kOutside && rng.chance(0.6)) state = SolidVoxels::kOutside;
  }
  return solid;
}

std::vector<PathSource> drawn_sources(const SolidVoxels& solid, Rng& rng) {
  std::vector<PathSource> sources;
  while (sources.size() < 3) {
    const std::size_t cell = rng.index(solid.states.size());
    if (solid.is_solid(cell)) {
      sources.push_back({static_cast<std::uint32_t>(cell), static_cast<float>(rng.uniform(0.0, 1.9))});
    }
  }
  return sources;
}

TEST(VoxelPaths, AreThoseOfDijkstra) {
  for (const SolidVoxels& solid : {sponge(), solid_of(two_fingers().mesh, 40, {{0.5, 0.3, 0.1}})}) {
    VoxelPaths paths(solid);
    const PathBounds none(solid, 0);
    Rng rng(1, "paths");
    for (int run = 0; run < 5; ++run) {
      const std::vector<PathSource> sources = drawn_sources(solid, rng);
      const std::vector<float> expected = dijkstra(solid, sources);
      const std::vector<float>& found = paths.run(sources, none, 0.0);
      for (std::size_t cell = 0; cell < expected.size(); ++cell) {
        if (solid.is_solid(cell)) {
          ASSERT_EQ(found[cell], expected[cell]);
        } else {
          ASSERT_EQ(found[cell], -std::numeric_limits<float>::infinity());
        }
      }
    }
  }
}

TEST(VoxelPaths, WithinBoundsTheNearestAreTheSame) {
  const SolidVoxels solid = solid_of(two_fingers().mesh, 40, {{0.5, 0.3, 0.1}});
  constexpr std::size_t kMost = 2, kJoints = 12;
  Rng rng(2, "bounded paths");
  std::vector<std::vector<PathSource>> sources;
  std::vector<double> before;
  for (std::size_t j = 0; j < kJoints; ++j) {
    sources.push_back(drawn_sources(solid, rng));
    before.push_back(j % 3 == 0 ? rng.uniform(0.0, 20.0) : 0.0);
  }
  VoxelPaths paths(solid), unbounded(solid);
  PathBounds bounds(solid, kMost);
  const PathBounds none(solid, 0);
  std::vector<std::vector<std::pair<double, std::size_t>>> nearest(solid.states.size()), expected = nearest;
  std::size_t cut = 0;
  for (std::size_t j = 0; j < kJoints; ++j) {
    const std::vector<float>& found = paths.run(sources[j], bounds, before[j]);
    bounds.add({{&found, before[j]}});
    const std::vector<float>& all = unbounded.run(sources[j], none, 0.0);
    for (std::size_t cell = 0; cell < found.size(); ++cell) {
      if (!solid.is_solid(cell)) continue;
      cut += found[cell] != all[cell];
      nearest[cell].emplace_back(found[cell] + before[j], j);
      expected[cell].emplace_back(all[cell] + before[j], j);
    }
  }
  EXPECT_GT(cut, nearest.size() / 4);  // or bounds would be of no use
  for (std::size_t cell = 0; cell < nearest.size(); ++cell) {
    if (!solid.is_solid(cell)) continue;
    std::sort(nearest[cell].begin(), nearest[cell].end());
    std::sort(expected[cell].begin(), expected[cell].end());
    for (std::size_t i = 0; i < kMost; ++i) ASSERT_EQ(nearest[cell][i], expected[cell][i]);
  }
}

TEST(WalkLine, TouchesEveryCellThatTheLineRunsThrough) {
  VoxelBlock block;
  block.resolution = 16;
  block.size = {16, 16, 16};
  block.cells_per_unit = 16.0;
  Rng rng(5, "lines");
  for (int run = 0; run < 200; ++run) {
    BoneLine line;
    for (Eigen::Vector3d* end : {&line.start, &line.end}) {
      for (int axis = 0; axis < 3; ++axis) (*end)[axis] = rng.uniform(-0.7, 0.7);
    }
    if (run % 5 == 0) line.end[run % 3] = line.start[run % 3] = 0.0;  // on a border between cells
    if (run % 50 == 0) line.end = line.start;
    std::vector<bool> touched(block.cells(), false);
    walk_line(block, line, [&](const std::vector<std::uint32_t>& cells) {
      for (const std::uint32_t cell : cells) {
        EXPECT_FALSE(touched[cell]);
        touched[cell] = true;
        const BoneLine measured{block.measured(line.start), block.measured(line.end)};
        EXPECT_LT(distance_to({{measured}, false}, block.center(cell)), 1.75);
      }
      return true;
    });
    for (int step = 0; step <= 1000; ++step) {
      const Eigen::Vector3d p = block.measured(line.start + (line.end - line.start) * step / 1000.0);
      if ((p.array() <= 0.0).any() || (p.array() >= 16.0).any()) continue;
      const auto cell = [&](double shift) {
        return block.index(static_cast<int>(p.x() + shift), static_cast<int>(p.y() + shift),
                           static_cast<int>(p.z() + shift));
      };
      ASSERT_TRUE(touched[cell(0.0)]) << "line " << run << " at " << p.transpose();
      if ((p.array() > 0.001).all()) {
        ASSERT_TRUE(touched[cell(-1e-9)]);
      }
    }
  }
}

TEST(WalkLine, GoesFromStartToEndAndStopsWhenTold) {
  VoxelBlock block;
  block.resolution = 16;
  block.size = {16, 16, 16};
  block.cells_per_unit = 16.0;
  for (const double direction : {1.0, -1.0}) {
    int slabs = 0, last = -1;
    walk_line(block, {{-0.4 * direction, 0.01, 0.01}, {0.4 * direction, 0.1, 0.1}},
              [&](const std::vector<std::uint32_t>& cells) {
                const int slab = block.cell(cells.front())[0];
                if (last >= 0) {
                  EXPECT_EQ(slab, direction > 0.0 ? last + 1 : last - 1);
                }
                last = slab;
                return ++slabs < 5;
              });
    EXPECT_EQ(slabs, 5);
  }
}

}  // namespace
}  // namespace anigen::rigging
