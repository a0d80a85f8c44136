// Binding a mesh to a skeleton: the shortest paths over solid voxels that geodesic binding is made of, ours with
// buckets against a binary heap on the same cells and sources, and what bounds save; then the three bindings whole, by
// vertices. Compare only figures of one run.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <queue>
#include <string>
#include <vector>

#include "anigen/core/parallel.h"
#include "anigen/rigging/binding.h"
#include "anigen/rigging/voxels.h"
#include "benchmarks/bumpy_torus.h"
#include "benchmarks/ratio_reporter.h"

namespace {

using namespace anigen;
using namespace anigen::rigging;

constexpr int kJoints = 48;

/// Joints along the middle of the tube; a chain, so that each has a bone.
Skeleton ring_skeleton(const Mesh& mesh) {
  double radius = 0.0;
  for (const Eigen::Vector3f& p : mesh.vertices) radius += static_cast<double>(p.head<2>().norm());
  radius /= static_cast<double>(mesh.vertices.size());
  std::vector<Eigen::Vector3d> joints;
  std::vector<int> parents;
  for (int j = 0; j < kJoints; ++j) {
    const double angle = 6.0 * j / kJoints;
    joints.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0.0);
    parents.push_back(j - 1);
  }
  return skeleton_from_joints(joints, parents);
}

std::vector<float> by_heap(const SolidVoxels& solid, const std::vector<PathSource>& sources) {
  const auto x = static_cast<std::ptrdiff_t>(solid.block.stride(0)),
             y = static_cast<std::ptrdiff_t>(solid.block.stride(1));
  std::vector<std::pair<std::ptrdiff_t, float>> steps;
  for (int n = 0; n < 27; ++n) {
    const int dx = n / 9 - 1, dy = n / 3 % 3 - 1, dz = n % 3 - 1;
    if (n != 13) steps.emplace_back(dx * x + dy * y + dz, std::sqrt(static_cast<float>(dx * dx + dy * dy + dz * dz)));
  }
  std::vector<float> distances(solid.states.size(), -std::numeric_limits<float>::infinity());
  for (std::size_t cell = 0; cell < distances.size(); ++cell) {
    if (solid.is_solid(cell)) distances[cell] = std::numeric_limits<float>::infinity();
  }
  using Entry = std::pair<float, std::ptrdiff_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> heap;
  const auto offer = [&](std::ptrdiff_t cell, float distance) {
    float& known = distances[static_cast<std::size_t>(cell)];
    if (!(distance < known)) return;
    known = distance;
    heap.emplace(distance, cell);
  };
  for (const PathSource& source : sources) offer(source.cell, source.distance);
  while (!heap.empty()) {
    const auto [distance, cell] = heap.top();
    heap.pop();
    if (distance != distances[static_cast<std::size_t>(cell)]) continue;
    for (const auto& [offset, length] : steps) offer(cell + offset, distance + length);
  }
  return distances;
}

void add(const std::string& name, const std::string& counter, std::size_t items, const std::function<void()>& body) {
  benchmark::RegisterBenchmark(name.c_str(),
                               [counter, items, body](benchmark::State& state) {
                                 for (auto _ : state) body();
                                 const auto count =
                                     static_cast<double>(state.iterations()) * static_cast<double>(items);
                                 state.counters[counter] = benchmark::Counter(count, benchmark::Counter::kIsRate);
                               })
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond)
      ->Repetitions(3);
}

}  // namespace

int main(int argc, char** argv) {
  set_thread_count(1);
  const std::string counter = "per_second";
  const Mesh mesh = bumpy_torus(158, 158);
  const Skeleton skeleton = ring_skeleton(mesh);
  const WeldedSurface surface = weld_surface(mesh);
  const std::vector<MovingBones> bones = moving_bones(skeleton, surface);
  const SolidVoxels solid = solid_voxels(surface, bones, 256);
  std::size_t cells = 0;
  for (std::size_t cell = 0; cell < solid.states.size(); ++cell) cells += solid.is_solid(cell);
  std::vector<PathSource> sources;
  for (std::size_t cell = 0; cell < solid.states.size() && sources.empty(); ++cell) {
    if (solid.states[cell] == SolidVoxels::kInside) sources.push_back({static_cast<std::uint32_t>(cell), 0.0F});
  }
  VoxelPaths paths(solid);
  const PathBounds none(solid, 0);
  std::printf("%zu solid of %zu voxels, %zu vertices, %d joints; paths to every solid voxel: %s\n", cells,
              solid.states.size(), mesh.vertices.size(), kJoints,
              paths.run(sources, none, 0.0) == by_heap(solid, sources) ? "the same bits" : "DIFFERENT");
  add("paths/buckets", counter, cells, [&] { benchmark::DoNotOptimize(paths.run(sources, none, 0.0).data()); });
  add("paths/heap", counter, cells, [&] { benchmark::DoNotOptimize(by_heap(solid, sources).data()); });
  for (const std::size_t most : {std::size_t{4}, std::size_t{0}}) {
    GeodesicVoxelOptions options;
    options.most_influences = most;
    add(most > 0 ? "geovoxel/4_influences" : "geovoxel/all_influences", counter, mesh.vertices.size(),
        [&, options] { benchmark::DoNotOptimize(bind_by_geodesic_voxels(mesh, skeleton, options).influences.data()); });
  }
  add("heat", counter, mesh.vertices.size(),
      [&] { benchmark::DoNotOptimize(bind_by_heat(mesh, skeleton).influences.data()); });
  add("nearest", counter, mesh.vertices.size(),
      [&] { benchmark::DoNotOptimize(bind(SkinBinding::kNearest, mesh, skeleton).influences.data()); });

  benchmark::Initialize(&argc, argv);
  anigen::benchmarks::RatioReporter reporter(counter);
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("\nRatios of rates (fastest of the repetitions):\n");
  reporter.print_ratio("shortest paths: buckets over a heap", "paths/buckets", "paths/heap");
  reporter.print_ratio("geodesic binding: 4 influences over all", "geovoxel/4_influences", "geovoxel/all_influences");
  reporter.print_ratio("heat over geodesic binding", "heat", "geovoxel/4_influences");
  benchmark::Shutdown();
  return 0;
}
