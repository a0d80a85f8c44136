// Nearest point on a surface: 100,000 queries on a mesh of 50,000 triangles, as skin transfer asks them, by ours
// (Embree), CGAL's AABB tree, every triangle in turn, and the nearest vertex; and how wrong the nearest vertex is.
// Ratios are printed at the end; compare only figures of one run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#ifdef ANIGEN_WITH_CGAL
#include <CGAL/Simple_cartesian.h>
#include "benchmarks/cgal_tree.h"
#endif

#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/sampling.h"
#include "benchmarks/bumpy_torus.h"
#include "benchmarks/ratio_reporter.h"

namespace {

using anigen::Mesh;
using anigen::Rng;
using Points = std::vector<Eigen::Vector3d>;

constexpr std::size_t kQueries = 100000, kBruteQueries = 100;

/// Points of another surface that lies close by: where skin transfer looks things up. In random order.
Points near_surface(const Mesh& mesh, std::size_t count) {
  Rng rng(1, "benchmark points");
  Points points;
  for (const auto& at : anigen::geometry::sample_surface(mesh.vertices, mesh.faces, count, rng))
    points.push_back(anigen::geometry::position(at, mesh.vertices, mesh.faces));
  for (Eigen::Vector3d& point : points) point += 0.01 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
  return points;
}

Points in_box(std::size_t count) {
  Rng rng(2, "benchmark points");
  Points points;
  for (std::size_t i = 0; i < count; ++i)
    points.emplace_back(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5));
  return points;
}

/// Two joints whose weights change smoothly along x and around the ring: known everywhere on the surface.
std::vector<float> true_weights(const Eigen::Vector3d& p) {
  const auto w = static_cast<float>(0.5 + 0.5 * std::sin(6.0 * p.x() + 2.0 * std::atan2(p.y(), p.x())));
  return {w, 1.0f - w};
}

double mean_l1(const anigen::SkinWeights& found, const Points& points) {
  const std::vector<float> dense = anigen::to_dense(found, 2);
  double sum = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::vector<float> truth = true_weights(points[i]);
    sum += std::abs(dense[2 * i] - truth[0]) + std::abs(dense[2 * i + 1] - truth[1]);
  }
  return sum / static_cast<double>(points.size());
}

/// Error of weights moved from an unevenly sampled mesh to points on the same surface.
void print_transfer_errors() {
  std::printf("\nSkin transfer, mean l1 error of the weights at 100000 points of the surface:\n");
  std::printf("%-34s %12s %15s %8s\n", "source mesh", "barycentric", "nearest vertex", "ratio");
  for (const auto& [name, rings, gather] :
       {std::tuple{"even, 12,800 triangles", 80, 1.0}, std::tuple{"uneven (power 2), 12,800", 80, 2.0},
        std::tuple{"uneven (power 3), 12,800", 80, 3.0}}) {
    const Mesh mesh = bumpy_torus(rings, rings, gather);
    std::vector<float> dense;
    Points vertices;
    for (const Eigen::Vector3f& vertex : mesh.vertices) {
      vertices.push_back(vertex.cast<double>());
      for (const float weight : true_weights(vertices.back())) dense.push_back(weight);
    }
    const anigen::SkinWeights skin = anigen::from_dense(dense, vertices.size(), 2);
    // On the mesh itself, so that only the transfer is at fault.
    Rng rng(3, "benchmark points");
    Points points;
    for (const auto& at : anigen::geometry::sample_surface(mesh.vertices, mesh.faces, kQueries, rng))
      points.push_back(anigen::geometry::position(at, mesh.vertices, mesh.faces));
    const double exact = mean_l1(anigen::geometry::transfer_skin(mesh, skin, points), points);
    const double vertex = mean_l1(anigen::geometry::transfer_skin_by_vertex(vertices, skin, points), points);
    std::printf("%-34s %12.5f %15.5f %8.1f\n", name, exact, vertex, vertex / exact);
  }
}

void add(const std::string& name, int threads, std::size_t queries, std::function<void()> body) {
  benchmark::RegisterBenchmark(name.c_str(),
                               [=](benchmark::State& state) {
                                 anigen::set_thread_count(threads);
                                 for (auto _ : state) body();
                                 state.counters["queries_per_second"] = benchmark::Counter(
                                     static_cast<double>(static_cast<std::size_t>(state.iterations()) * queries),
                                     benchmark::Counter::kIsRate);
                               })
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond)
      ->Repetitions(3);
}

/// One query per call of `one`, in blocks so that handing out work costs nothing.
void each_point(const Points& points, const std::function<void(const Eigen::Vector3d&)>& one) {
  constexpr std::size_t kBlock = 256;
  anigen::parallel_for((points.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(points.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) one(points[i]);
  });
}

#ifdef ANIGEN_WITH_CGAL
using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = anigen::benchmarks::CgalPrimitive<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<anigen::benchmarks::CgalTraits<Kernel, Primitive>>;

Kernel::Point_3 cgal_point(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

Triangles cgal_triangles(const Mesh& mesh) {
  Triangles triangles;
  for (const anigen::Triangle& face : mesh.faces) {
    const auto corner = [&](std::size_t k) {
      return cgal_point(mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>());
    };
    triangles.emplace_back(corner(0), corner(1), corner(2));
  }
  return triangles;
}
#endif

}  // namespace

int main(int argc, char** argv) {
  const Mesh mesh = bumpy_torus(158, 158, 1.0);
  const anigen::geometry::NearestSurface surface(mesh);
  Points vertices;
  for (const Eigen::Vector3f& vertex : mesh.vertices) vertices.push_back(vertex.cast<double>());
  const anigen::geometry::PointIndex index(vertices);
  const std::map<std::string, Points> sets = {{"near", near_surface(mesh, kQueries)}, {"box", in_box(kQueries)}};
  std::printf("%zu triangles, %zu queries\n", mesh.faces.size(), kQueries);

#ifdef ANIGEN_WITH_CGAL
  const Triangles triangles = cgal_triangles(mesh);
  CgalTree tree(triangles.begin(), triangles.end());
  tree.build();
  tree.accelerate_distance_queries();
#else
  std::printf("CGAL not found: that row is left out\n");
#endif
  for (const auto& [set, points] : sets) {
    const Points* queries = &points;
    for (const int threads : {1, 2}) {
      const std::string end = "/" + set + "/" + std::to_string(threads);
      add("anigen" + end, threads, kQueries, [&, queries] { benchmark::DoNotOptimize(surface.query(*queries)); });
#ifdef ANIGEN_WITH_CGAL
      add("cgal" + end, threads, kQueries, [&, queries] {
        each_point(*queries, [&](const Eigen::Vector3d& p) {
          benchmark::DoNotOptimize(tree.closest_point_and_primitive(cgal_point(p)));
        });
      });
#endif
    }
    add("anigen_one_by_one/" + set + "/1", 1, kQueries, [&, queries] {
      each_point(*queries, [&](const Eigen::Vector3d& p) { benchmark::DoNotOptimize(surface.query(p)); });
    });
    add("nearest_vertex/" + set + "/1", 1, kQueries, [&, queries] {
      each_point(*queries, [&](const Eigen::Vector3d& p) { benchmark::DoNotOptimize(index.nearest(p)); });
    });
    const Points few(points.begin(), points.begin() + kBruteQueries);
    add("brute_force/" + set + "/1", 1, kBruteQueries, [&mesh, few] {
      for (const Eigen::Vector3d& p : few) {
        double best = 1e300;
        for (const anigen::Triangle& face : mesh.faces) {
          const auto corner = [&](std::size_t k) {
            return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>());
          };
          best = std::min(best, anigen::geometry::nearest_on_triangle(p, corner(0), corner(1), corner(2)).distance);
        }
        benchmark::DoNotOptimize(best);
      }
    });
  }

  benchmark::Initialize(&argc, argv);
  anigen::benchmarks::RatioReporter reporter("queries_per_second");
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("\nRatios of queries per second (fastest of the repetitions):\n");
  for (const char* name : {"near", "box"}) {
    const std::string set = std::string("/") + name + "/";
    reporter.print_ratio(set + ": ours, 2 threads over 1", "anigen" + set + "2", "anigen" + set + "1");
    reporter.print_ratio(set + ": ours over CGAL, 1 thread", "anigen" + set + "1", "cgal" + set + "1");
    reporter.print_ratio(set + ": ours over CGAL, 2 threads", "anigen" + set + "2", "cgal" + set + "2");
    reporter.print_ratio(set + ": ours one by one over CGAL, 1 thread", "anigen_one_by_one" + set + "1",
                         "cgal" + set + "1");
    reporter.print_ratio(set + ": ours over every triangle, 1 thread", "anigen" + set + "1", "brute_force" + set + "1");
    reporter.print_ratio(set + ": nearest vertex over ours, 1 thread", "nearest_vertex" + set + "1",
                         "anigen" + set + "1");
  }
  print_transfer_errors();
  benchmark::Shutdown();
  return 0;
}
