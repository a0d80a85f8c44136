// The differentiable rasteriser on a mesh of 262,144 triangles at 512 x 512, as the published training renders:
// visibility, the whole renderer, and both with their backward passes; beside the ray tracer's visibility of the same
// view, with and without the tree that it has to build anew whenever the mesh moves. All are timed in turn, round after
// round, so that a machine whose speed wanders treats them alike; compare only figures of one run. Prints a table;
// with --benchmark_out=FILE also Google Benchmark's JSON. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/parallel.h"
#include "anigen/raster/antialias.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/bumpy_torus.h"

namespace {

using torch::Tensor;

constexpr int kRounds = 9, kRings = 512, kSegments = 256;
constexpr std::int64_t kPixels = 512;

struct Task {
  std::string name;
  std::function<void()> work;
  std::vector<double> seconds;

  double median() const {
    std::vector<double> sorted = seconds;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }
};

Tensor tensor_of(const Eigen::MatrixXd& matrix) {
  Tensor tensor = torch::empty({matrix.rows(), matrix.cols()});
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) tensor[i][j].fill_(matrix(i, j));
  }
  return tensor;
}

struct Case {
  Case() {
    asset.mesh = bumpy_torus(kRings, kSegments);
    vertices = torch::empty({static_cast<std::int64_t>(asset.mesh.vertices.size()), 3});
    faces = torch::empty({static_cast<std::int64_t>(asset.mesh.faces.size()), 3}, torch::kInt64);
    float* vertex = vertices.data_ptr<float>();
    for (const Eigen::Vector3f& point : asset.mesh.vertices) {
      for (Eigen::Index k = 0; k < 3; ++k) *vertex++ = point[k];
    }
    std::int64_t* corner = faces.data_ptr<std::int64_t>();
    for (const anigen::Triangle& face : asset.mesh.faces) {
      for (const int index : face) *corner++ = index;
    }
    const anigen::render::ViewCamera camera{0.6, 0.7, anigen::render::kFeatureRadius, anigen::render::kFeatureFov};
    frame = anigen::render::make_frame(camera, "000.png");
    extrinsics = tensor_of(anigen::render::extrinsics_of(anigen::render::camera_to_world(camera)));
    intrinsics = tensor_of(anigen::render::intrinsics_of(camera.fov));
    attributes = torch::rand({vertices.size(0), 6});
    vertices.requires_grad_();
    attributes.requires_grad_();
  }

  Tensor clip() const {
    return anigen::raster::to_clip(vertices, extrinsics, anigen::raster::projection_matrix(intrinsics, 1.0, 3.0));
  }
  anigen::raster::Rendering render() const {
    return anigen::raster::render_mesh(vertices, faces, attributes, extrinsics, intrinsics, {});
  }

  anigen::Asset asset;
  anigen::render::Frame frame;
  Tensor vertices, faces, attributes, extrinsics, intrinsics;
};

void rasterize_only(const Case& c, bool backward) {
  const Tensor clip = c.clip();
  const Tensor seen = anigen::raster::rasterize(clip, c.faces, kPixels, kPixels).barycentric;
  if (backward) torch::autograd::grad({seen}, {c.vertices}, {torch::ones_like(seen)});
}

void render_all(const Case& c, bool backward) {
  const anigen::raster::Rendering found = c.render();
  if (!backward) return;
  const Tensor loss = found.mask.sum() + found.depth.sum() + found.normal.sum() + found.attributes.sum();
  torch::autograd::grad({loss}, {c.vertices, c.attributes});
}

void trace(const anigen::render::Scene& scene, const anigen::render::Frame& frame) {
  anigen::render::ViewOptions options;
  options.size = static_cast<int>(kPixels);
  options.color = false;
  options.visibility = true;
  anigen::render::render_view(scene, frame, options);
}

void run(std::vector<Task>& tasks) {
  for (int round = -1; round < kRounds; ++round) {  // the first one warms up
    for (Task& task : tasks) {
      const auto begin = std::chrono::steady_clock::now();
      task.work();
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (round >= 0) task.seconds.push_back(seconds);
    }
  }
}

void write_json(const std::string& file, const std::vector<Task>& tasks) {
  anigen::Json list = anigen::Json::array();
  for (const Task& task : tasks) {
    const double milliseconds = 1e3 * task.median();
    list.push_back({{"name", "rasterizer/" + task.name},
                    {"run_type", "iteration"},
                    {"iterations", kRounds},
                    {"real_time", milliseconds},
                    {"cpu_time", milliseconds},
                    {"time_unit", "ms"},
                    {"times_ray_traced_visibility", task.median() / tasks.front().median()}});
  }
  const anigen::Json json = {{"context", {{"executable", "benchmark_rasterizer"}}}, {"benchmarks", list}};
  anigen::write_file_atomically(file, json.dump(2) + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::benchmark_flags(argc, argv);
  if (!flags) return 2;
  at::set_num_threads(anigen::thread_count());
  torch::manual_seed(0);
  const Case c;
  const anigen::render::Scene scene(c.asset);
  std::vector<Task> tasks;  // the first is what the others are compared with
  tasks.push_back({"ray_traced_visibility", [&] { trace(scene, c.frame); }, {}});
  tasks.push_back({"tree_and_ray_traced_visibility", [&] { trace(anigen::render::Scene(c.asset), c.frame); }, {}});
  tasks.push_back({"rasterize", [&] { rasterize_only(c, false); }, {}});
  tasks.push_back({"rasterize_backward", [&] { rasterize_only(c, true); }, {}});
  tasks.push_back({"render", [&] { render_all(c, false); }, {}});
  tasks.push_back({"render_backward", [&] { render_all(c, true); }, {}});
  run(tasks);
  const double covered = c.render().mask.mean().item<double>();
  std::printf("%zu triangles, %lld x %lld pixels, %.0f %% of them covered, %d threads; medians of %d rounds\n",
              c.asset.mesh.faces.size(), static_cast<long long>(kPixels), static_cast<long long>(kPixels),
              100.0 * covered, at::get_num_threads(), kRounds);
  std::printf("%-32s | %10s %28s\n", "", "ms", "x ray-traced visibility");
  for (const Task& task : tasks) {
    std::printf("%-32s | %10.2f %28.2f\n", task.name.c_str(), 1e3 * task.median(),
                task.median() / tasks.front().median());
  }
  std::printf("render: mask, depth, normals and six attributes, antialiased; …_backward: forward and backward\n");
  if (!flags->out.empty()) write_json(flags->out, tasks);
  return 0;
}
