// Surface voxels: ours against the separating-axis test of every voxel in each triangle's box, and against CGAL, asked
// both ways: every voxel in each triangle's box, and an AABB tree asked about every voxel of the grid. All on the same
// meshes in one run; the sets are compared first. Compare only figures of one run.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#ifdef ANIGEN_WITH_CGAL
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/intersections.h>
#include "benchmarks/cgal_tree.h"
#endif

#include "anigen/core/parallel.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/geometry/voxelize.h"
#include "benchmarks/bumpy_torus.h"
#include "benchmarks/ratio_reporter.h"
#include "tests/geometry/voxel_brute_force.h"

namespace {

using anigen::Mesh;
using anigen::geometry::Voxel;
using anigen::geometry::VoxelBits;

/// Calls meets(triangle, voxel) for the voxels in the box of each triangle that are not set yet.
template <typename Meets>
std::vector<Voxel> by_boxes(const Mesh& mesh, int resolution, const Meets& meets) {
  VoxelBits voxels(resolution);
  for (const anigen::Triangle& face : mesh.faces) {
    const auto triangle = anigen::test::grid_triangle(mesh.vertices, face, resolution);
    anigen::test::for_candidates(triangle, resolution, [&](const Voxel& voxel) {
      if (!voxels.contains(voxel) && meets(triangle, voxel)) voxels.insert(voxel);
    });
  }
  return voxels.voxels();
}

std::vector<Voxel> by_brute_force(const Mesh& mesh, int resolution) {
  return by_boxes(mesh, resolution, [](const anigen::test::GridTriangle& triangle, const Voxel& voxel) {
    return anigen::test::separation(triangle, voxel, 0.0) <= 0.0;
  });
}

#ifdef ANIGEN_WITH_CGAL
template <typename Kernel>
typename Kernel::Triangle_3 cgal_triangle(const anigen::test::GridTriangle& t) {
  const auto corner = [&](std::size_t k) { return typename Kernel::Point_3(t[k].x(), t[k].y(), t[k].z()); };
  return {corner(0), corner(1), corner(2)};
}

CGAL::Bbox_3 cgal_box(const Voxel& v) {
  return {double(v[0]), double(v[1]), double(v[2]), v[0] + 1.0, v[1] + 1.0, v[2] + 1.0};
}

template <typename Kernel>
std::vector<Voxel> by_cgal_boxes(const Mesh& mesh, int resolution) {
  return by_boxes(mesh, resolution, [](const anigen::test::GridTriangle& triangle, const Voxel& voxel) {
    return CGAL::do_intersect(cgal_triangle<Kernel>(triangle), cgal_box(voxel));
  });
}

std::vector<Voxel> by_cgal_tree(const Mesh& mesh, int resolution) {
  using Kernel = CGAL::Simple_cartesian<double>;
  using Triangles = std::vector<Kernel::Triangle_3>;
  using Primitive = anigen::benchmarks::CgalPrimitive<Kernel, Triangles::const_iterator>;
  Triangles triangles;
  for (const anigen::Triangle& face : mesh.faces)
    triangles.push_back(cgal_triangle<Kernel>(anigen::test::grid_triangle(mesh.vertices, face, resolution)));
  CGAL::AABB_tree<anigen::benchmarks::CgalTraits<Kernel, Primitive>> tree(triangles.begin(), triangles.end());
  tree.build();
  std::vector<Voxel> voxels;
  for (int x = 0; x < resolution; ++x) {
    for (int y = 0; y < resolution; ++y) {
      for (int z = 0; z < resolution; ++z) {
        if (tree.do_intersect(cgal_box({x, y, z}))) voxels.push_back({x, y, z});
      }
    }
  }
  return voxels;
}
#endif

struct Case {
  std::string name;
  Mesh mesh;
  int resolution;
  std::vector<Voxel> voxels;
};

void add(const std::string& method, const Case& input, int threads,
         const std::function<std::vector<Voxel>(const Mesh&, int)>& body) {
  benchmark::RegisterBenchmark((method + "/" + input.name).c_str(),
                               [&input, threads, body](benchmark::State& state) {
                                 anigen::set_thread_count(threads);
                                 for (auto _ : state) benchmark::DoNotOptimize(body(input.mesh, input.resolution));
                                 const auto count = static_cast<std::size_t>(state.iterations()) * input.voxels.size();
                                 state.counters["voxels_per_second"] =
                                     benchmark::Counter(static_cast<double>(count), benchmark::Counter::kIsRate);
                               })
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond)
      ->Repetitions(3);
}

std::vector<Voxel> ours(const Mesh& mesh, int resolution) {
  return anigen::geometry::voxelize_surface(mesh.vertices, mesh.faces, resolution);
}

void print_difference(const std::string& what, const std::vector<Voxel>& a, const std::vector<Voxel>& b) {
  std::vector<Voxel> different;
  std::set_symmetric_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(different));
  std::printf("  %-44s %zu of %zu voxels differ\n", what.c_str(), different.size(), a.size());
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<Case> cases;
  cases.push_back({"50k_triangles_64", bumpy_torus(158, 158), 64, {}});
  cases.push_back({"50k_triangles_256", bumpy_torus(158, 158), 256, {}});
  cases.push_back({"200_triangles_64", bumpy_torus(10, 10), 64, {}});
  for (Case& input : cases) {
    input.voxels = ours(input.mesh, input.resolution);
    std::printf("%s: %zu triangles, %zu voxels\n", input.name.c_str(), input.mesh.faces.size(), input.voxels.size());
    print_difference("ours against brute force:", input.voxels, by_brute_force(input.mesh, input.resolution));
    add("anigen_1", input, 1, ours);
    add("anigen_2", input, 2, ours);
    add("brute_force", input, 1, by_brute_force);
#ifdef ANIGEN_WITH_CGAL
    using Inexact = CGAL::Simple_cartesian<double>;
    using Exact = CGAL::Exact_predicates_inexact_constructions_kernel;
    print_difference("ours against CGAL, exact predicates:", input.voxels,
                     by_cgal_boxes<Exact>(input.mesh, input.resolution));
    add("cgal_boxes", input, 1, by_cgal_boxes<Inexact>);
    add("cgal_exact_boxes", input, 1, by_cgal_boxes<Exact>);
    if (input.resolution <= 64) add("cgal_tree", input, 1, by_cgal_tree);
#else
    std::printf("  CGAL not found: its rows are left out\n");
#endif
  }

  benchmark::Initialize(&argc, argv);
  anigen::benchmarks::RatioReporter reporter("voxels_per_second");
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("\nRatios of voxels per second (fastest of the repetitions):\n");
  for (const Case& input : cases) {
    const std::string end = "/" + input.name;
    for (const auto& [name, row] :
         {std::pair{"brute force", "brute_force"}, std::pair{"CGAL, boxes", "cgal_boxes"},
          std::pair{"CGAL, boxes, exact predicates", "cgal_exact_boxes"}, std::pair{"CGAL, AABB tree", "cgal_tree"}}) {
      reporter.print_ratio(input.name + ": ours over " + name + ", 1 thread", "anigen_1" + end, row + end);
    }
    reporter.print_ratio(input.name + ": ours, 2 threads over 1", "anigen_2" + end, "anigen_1" + end);
  }
  benchmark::Shutdown();
  return 0;
}
