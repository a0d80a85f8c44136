// Primary rays per second of the view renderer, on the camera of a published view of an object of 40,000 triangles,
// beside Embree alone on the very same rays: rtcIntersect1 as renderers commonly call it, and rtcIntersect16, the
// fastest it offers for rays that start together; and the plain tree of lean builds. Ratios are printed at the end;
// compare only figures of one run.
//   benchmark_raytrace [FILE.glb] [--benchmark_… options]
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/embree.h"
#include "anigen/geometry/triangle_tree.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/render/dataset_views.h"
#include "benchmarks/ratio_reporter.h"

namespace {

using anigen::Asset;
using anigen::render::Camera;
using anigen::render::Scene;
using anigen::render::ViewOptions;

constexpr int kSize = 1024;

/// A bumpy ball of 40,000 triangles and size about 1, without textures.
Asset ball() {
  constexpr double kPi = 3.14159265358979323846;
  constexpr int kRings = 100, kSegments = 200;
  Asset asset;
  asset.name = "ball";
  for (int r = 0; r <= kRings; ++r) {
    for (int s = 0; s <= kSegments; ++s) {
      const double polar = kPi * r / kRings, around = 2.0 * kPi * s / kSegments;
      const double radius = 0.45 + 0.04 * std::sin(9.0 * polar) * std::cos(7.0 * around);
      asset.mesh.vertices.push_back(Eigen::Vector3d(radius * std::sin(polar) * std::cos(around),
                                                    radius * std::sin(polar) * std::sin(around),
                                                    radius * std::cos(polar))
                                        .cast<float>());
    }
  }
  for (int r = 0; r < kRings; ++r) {
    for (int s = 0; s < kSegments; ++s) {
      const int a = r * (kSegments + 1) + s, b = a + kSegments + 1;
      asset.mesh.faces.push_back({a, b, b + 1});
      asset.mesh.faces.push_back({a, b + 1, a + 1});
    }
  }
  return asset;
}

void add(const std::string& name, int threads, double rays, std::function<void()> body) {
  benchmark::RegisterBenchmark((name + "/" + std::to_string(threads)).c_str(),
                               [=](benchmark::State& state) {
                                 anigen::set_thread_count(threads);
                                 for (auto _ : state) body();
                                 state.counters["rays_per_second"] = benchmark::Counter(
                                     static_cast<double>(state.iterations()) * rays, benchmark::Counter::kIsRate);
                               })
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond)
      ->Repetitions(3);
}

/// The rays through all pixel centres, 4 × 4 pixels after each other; what Embree alone is given.
std::vector<Eigen::Vector3f> view_rays(const Camera& camera) {
  std::vector<Eigen::Vector3f> rays;
  for (int top = 0; top < kSize; top += 4) {
    for (int left = 0; left < kSize; left += 4) {
      for (int i = 0; i < 16; ++i) rays.push_back(camera.ray(left + i % 4 + 0.5, top + i / 4 + 0.5).cast<float>());
    }
  }
  return rays;
}

constexpr std::size_t kBlock = 4 * kSize;  ///< rays of four rows of pixels: what a thread takes at once

void bare_single(RTCScene scene, const Eigen::Vector3f& eye, const std::vector<Eigen::Vector3f>& rays) {
  anigen::parallel_for(rays.size() / kBlock, [&](std::size_t block) {
    for (std::size_t i = block * kBlock; i < (block + 1) * kBlock; ++i) {
      RTCRayHit query{};
      query.ray.org_x = eye.x();
      query.ray.org_y = eye.y();
      query.ray.org_z = eye.z();
      query.ray.dir_x = rays[i].x();
      query.ray.dir_y = rays[i].y();
      query.ray.dir_z = rays[i].z();
      query.ray.tfar = std::numeric_limits<float>::infinity();
      query.ray.mask = 0xFFFFFFFFu;
      query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      anigen::geometry::embree_intersect(scene, query);
      benchmark::DoNotOptimize(query.hit.primID);
    }
  });
}

void bare_packets(RTCScene scene, const Eigen::Vector3f& eye, const std::vector<Eigen::Vector3f>& rays) {
  anigen::parallel_for(rays.size() / kBlock, [&](std::size_t block) {
    alignas(64) int valid[16];
    std::fill(valid, valid + 16, -1);
    for (std::size_t first = block * kBlock; first < (block + 1) * kBlock; first += 16) {
      RTCRayHit16 query;
      for (std::size_t i = 0; i < 16; ++i) {
        query.ray.org_x[i] = eye.x();
        query.ray.org_y[i] = eye.y();
        query.ray.org_z[i] = eye.z();
        query.ray.dir_x[i] = rays[first + i].x();
        query.ray.dir_y[i] = rays[first + i].y();
        query.ray.dir_z[i] = rays[first + i].z();
        query.ray.tnear[i] = query.ray.time[i] = 0.0f;
        query.ray.tfar[i] = std::numeric_limits<float>::infinity();
        query.ray.mask[i] = 0xFFFFFFFFu;
        query.ray.id[i] = query.ray.flags[i] = 0;
        query.hit.geomID[i] = query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      }
      anigen::geometry::embree_intersect16(valid, scene, query);
      benchmark::DoNotOptimize(query.hit.primID[0]);
    }
  });
}

void plain_single(const anigen::geometry::PlainTree& tree, const Eigen::Vector3f& eye,
                  const std::vector<Eigen::Vector3f>& rays) {
  anigen::parallel_for(rays.size() / kBlock, [&](std::size_t block) {
    for (std::size_t i = block * kBlock; i < (block + 1) * kBlock; ++i)
      benchmark::DoNotOptimize(tree.first_hit({eye, rays[i]}));
  });
}

}  // namespace

int main(int argc, char** argv) {
  Asset asset = ball();
  if (argc > 1 && argv[1][0] != '-') {
    asset = anigen::io::read_gltf(argv[1]).asset;
    anigen::normalize(asset);
  }
  const anigen::render::Frame frame =
      anigen::render::make_frame(anigen::render::feature_views(24, 0.5, 0.5)[12], "012.png");
  const Camera camera = anigen::render::view_camera(frame, kSize);
  const Eigen::Vector3f eye = camera.eye.cast<float>();
  const std::vector<Eigen::Vector3f> rays = view_rays(camera);
  const anigen::geometry::EmbreeTree tree(asset.mesh.vertices, asset.mesh.faces);
  const anigen::geometry::PlainTree plain(asset.mesh.vertices, asset.mesh.faces);
  const Scene scene(asset);
  const anigen::render::ViewRenderer renderer(scene);
  ViewOptions geometry;
  geometry.size = kSize;
  geometry.color = false;
  geometry.geometry = true;
  ViewOptions color;
  color.size = kSize;
  color.samples_per_axis = 1;
  ViewOptions smooth = color, unshadowed = color;
  smooth.samples_per_axis = 2;
  unshadowed.shadows = false;

  const auto covered = renderer.render(frame, geometry).mask;
  std::printf("%s: %zu triangles, %d x %d pixels, %.0f %% of them covered\n", asset.name.c_str(),
              asset.mesh.faces.size(), kSize, kSize,
              100.0 * std::count(covered.begin(), covered.end(), 1) / static_cast<double>(covered.size()));
  const auto count = static_cast<double>(rays.size());
  for (const int threads : {1, 2}) {
    add("embree_1", threads, count, [&] { bare_single(tree.scene(), eye, rays); });
    add("embree_16", threads, count, [&] { bare_packets(tree.scene(), eye, rays); });
    add("plain", threads, count, [&] { plain_single(plain, eye, rays); });
    add("depth_normal_mask", threads, count, [&] { benchmark::DoNotOptimize(renderer.render(frame, geometry)); });
    add("color_no_shadows", threads, count, [&] { benchmark::DoNotOptimize(renderer.render(frame, unshadowed)); });
    add("color", threads, count, [&] { benchmark::DoNotOptimize(renderer.render(frame, color)); });
    add("color_2x2", threads, 4 * count, [&] { benchmark::DoNotOptimize(renderer.render(frame, smooth)); });
  }

  benchmark::Initialize(&argc, argv);
  anigen::benchmarks::RatioReporter reporter("rays_per_second");
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("\nRatios of primary rays per second (fastest of the repetitions):\n");
  for (const std::string threads : {"/1", "/2"}) {
    const std::string end = threads == "/1" ? ", 1 thread" : ", 2 threads";
    reporter.print_ratio("the plain tree over bare rtcIntersect1" + end, "plain" + threads, "embree_1" + threads);
    reporter.print_ratio("depth, normal, mask over bare rtcIntersect1" + end, "depth_normal_mask" + threads,
                         "embree_1" + threads);
    reporter.print_ratio("depth, normal, mask over bare rtcIntersect16" + end, "depth_normal_mask" + threads,
                         "embree_16" + threads);
    reporter.print_ratio("lit colour with shadows, 2 x 2, over bare rtcIntersect1" + end, "color_2x2" + threads,
                         "embree_1" + threads);
  }
  reporter.print_ratio("lit colour with shadows, 2 x 2: 2 threads over 1", "color_2x2/2", "color_2x2/1");
  benchmark::Shutdown();
  return 0;
}
