// From an averaged field to a mesh: shape_field::flexicubes beside the same formulas as tensor operations on the whole
// grid, forward, and forward with backward. A bumpy sphere whose cubes are active in a shell, as a decoder's voxels are
// (so that there is a second surface inside), and ten attributes. Seconds and the memory that each call adds at its
// peak.
//   benchmark_flexicubes [--most=256] [--dense-most=128] [--rounds=3] [--benchmark_out=FILE]
// --most: finest grid, of 64, 128 and 256; --dense-most: finest one for the dense version, which needs many GB at
// 256. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/openblas.h"
#include "anigen/core/parallel.h"
#include "benchmarks/plain_flexicubes.h"

namespace {

using anigen::shape_field::CubeCorners;
using anigen::shape_field::CubeField;
using anigen::shape_field::ExtractedSurface;
using torch::Tensor;

constexpr std::int64_t kAttributes = 10;

struct Settings {
  long most = 256, dense_most = 128, rounds = 3;
  std::string out;
};

// A number of kB from /proc/self/status; 0 where there is no such file.
double status_megabytes(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.compare(0, key.size(), key) == 0)
      return static_cast<double>(std::strtol(line.c_str() + key.size() + 1, nullptr, 10)) / 1024.0;
  }
  return 0.0;
}

struct Measured {
  double seconds = 0.0;    // median
  double megabytes = 0.0;  // resident memory at the peak, less what was there before
};

Measured measure(long rounds, const std::function<void()>& work) {
  work();  // warms up
  std::vector<double> seconds;
  Measured measured;
  for (long i = 0; i < rounds; ++i) {
    const double before = status_megabytes("VmRSS:");
    std::ofstream("/proc/self/clear_refs") << "5";  // the peak starts again from here
    const auto start = std::chrono::steady_clock::now();
    work();
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    measured.megabytes = std::max(measured.megabytes, status_megabytes("VmHWM:") - before);
  }
  std::sort(seconds.begin(), seconds.end());
  measured.seconds = seconds[seconds.size() / 2];
  return measured;
}

// Signed distances of a bumpy sphere at places [..., 3].
Tensor bumpy_sphere(const Tensor& p) {
  const Tensor bumps =
      torch::sin(9.0 * p.select(-1, 0)) * torch::sin(8.0 * p.select(-1, 1)) * torch::sin(7.0 * p.select(-1, 2) + 1.0);
  return p.norm(2, -1) - 0.37 - 0.03 * bumps;
}

// Corner values as a decoder would give them: the shape, and small random rest.
CubeField field_of(std::int64_t resolution) {
  const auto size = static_cast<double>(resolution);
  const Tensor steps = torch::arange(resolution, torch::kInt32);
  const std::vector<Tensor> axes = torch::meshgrid({steps, steps, steps}, "ij");
  const Tensor all = torch::stack({axes[0].reshape({-1}), axes[1].reshape({-1}), axes[2].reshape({-1})}, 1);
  const Tensor centre = (all.to(torch::kFloat32) + 0.5) / size - 0.5;
  const Tensor active = bumpy_sphere(centre).abs().lt(3.0 / size).nonzero().squeeze(1);
  CubeCorners corners;
  corners.coords = all.index_select(0, active);
  const std::int64_t count = corners.coords.size(0);
  const Tensor offset =
      torch::tensor({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1}, torch::kInt32)
          .view({1, 8, 3});
  corners.sdf = bumpy_sphere((corners.coords.unsqueeze(1) + offset).to(torch::kFloat32) / size - 0.5);
  corners.deform = 0.3 * torch::randn({count, 8, 3});
  corners.attributes = torch::rand({count, 8, kAttributes});
  corners.weights = 0.3 * torch::randn({count, 21});
  return anigen::shape_field::average_corners(corners, resolution);
}

using Extract = std::function<ExtractedSurface(const CubeField&, bool)>;

ExtractedSurface dense(const CubeField& field, bool training) {
  return anigen::benchmarks::PlainFlexicubes(field).extract(training);
}

Measured forward(long rounds, const CubeField& field, const Extract& extract) {
  return measure(rounds, [&] {
    const torch::NoGradGuard no_grad;
    extract(field, false);
  });
}

Measured training(long rounds, const CubeField& field, const Extract& extract) {
  CubeField leaf = field;
  const std::vector<Tensor*> parts = {&leaf.sdf, &leaf.deform, &leaf.attributes, &leaf.weights};
  std::vector<Tensor> inputs;
  for (Tensor* part : parts) {
    *part = part->detach().clone().requires_grad_();
    inputs.push_back(*part);
  }
  return measure(rounds, [&] {
    const ExtractedSurface surface = extract(leaf, true);
    const Tensor loss = surface.vertices.square().sum() + surface.attributes.square().sum() + surface.deviation.mean();
    torch::autograd::grad({loss}, inputs);
  });
}

void report(const std::string& name, const Measured& ours, const Measured* other, anigen::Json& list) {
  std::printf("%-22s | %9.3f s %9.0f MB", name.c_str(), ours.seconds, ours.megabytes);
  if (other != nullptr) {
    std::printf(" | dense %9.3f s %9.0f MB | %6.1f times faster, %5.1f times smaller", other->seconds, other->megabytes,
                other->seconds / ours.seconds, other->megabytes / std::max(1.0, ours.megabytes));
  }
  std::printf("\n");
  const auto entry = [&](const std::string& label, const Measured& measured) {
    list.push_back({{"name", "flexicubes/" + label},
                    {"run_type", "iteration"},
                    {"iterations", 1},
                    {"real_time", 1e3 * measured.seconds},
                    {"cpu_time", 1e3 * measured.seconds},
                    {"time_unit", "ms"},
                    {"peak_megabytes", measured.megabytes}});
  };
  entry(name, ours);
  if (other != nullptr) entry(name + "_dense", *other);
}

void run(std::int64_t resolution, const Settings& settings, anigen::Json& list) {
  torch::manual_seed(0);
  const CubeField field = field_of(resolution);
  const ExtractedSurface surface = anigen::shape_field::flexicubes(field, false);
  std::printf("R = %lld: %lld active cubes, %lld vertices, %lld faces\n", static_cast<long long>(resolution),
              static_cast<long long>(field.coords.size(0)), static_cast<long long>(surface.vertices.size(0)),
              static_cast<long long>(surface.faces.size(0)));
  const bool with_dense = resolution <= settings.dense_most;
  const std::string at_resolution = "_" + std::to_string(resolution);
  const Measured ours = forward(settings.rounds, field, anigen::shape_field::flexicubes);
  const Measured ours_training = training(settings.rounds, field, anigen::shape_field::flexicubes);
  Measured other, other_training;
  if (with_dense) {
    other = forward(settings.rounds, field, dense);
    other_training = training(settings.rounds, field, dense);
    const ExtractedSurface check = dense(field, false);
    const bool same = torch::equal(check.faces, surface.faces);
    std::printf("faces %s; largest difference of vertices %.1e\n", same ? "equal" : "DIFFER",
                same ? (check.vertices - surface.vertices).abs().max().item<double>() : std::nan(""));
  }
  report("forward" + at_resolution, ours, with_dense ? &other : nullptr, list);
  report("training" + at_resolution, ours_training, with_dense ? &other_training : nullptr, list);
}

bool read_flag(const std::string& word, const std::string& name, long& value) {
  const std::string flag = "--" + name + "=";
  if (word.compare(0, flag.size(), flag) != 0) return false;
  value = std::max(1L, std::strtol(word.c_str() + flag.size(), nullptr, 10));
  return true;
}

bool read_settings(int argc, char** argv, Settings& settings) {
  const std::string out = "--benchmark_out=";
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.compare(0, out.size(), out) == 0) {
      settings.out = word.substr(out.size());
    } else if (!read_flag(word, "most", settings.most) && !read_flag(word, "dense-most", settings.dense_most) &&
               !read_flag(word, "rounds", settings.rounds) && word.compare(0, 12, "--benchmark_") != 0) {
      return false;
    }
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  anigen::start_with_openblas_core(argv);  // as the programs do
  Settings settings;
  if (!read_settings(argc, argv, settings)) {
    std::fprintf(stderr,
                 "usage: benchmark_flexicubes [--most=N] [--dense-most=N] [--rounds=N] [--benchmark_out=FILE]\n");
    return 2;
  }
  try {
    at::set_num_threads(anigen::thread_count());
    std::printf("%d threads, fp32, medians of %ld rounds\n", at::get_num_threads(), settings.rounds);
    anigen::Json list = anigen::Json::array();
    for (const std::int64_t resolution : {64, 128, 256}) {
      if (resolution <= settings.most) run(resolution, settings, list);
    }
    if (settings.out.empty()) return 0;
    const anigen::Json json = {{"context", {{"executable", "benchmark_flexicubes"}}}, {"benchmarks", list}};
    anigen::write_file_atomically(settings.out, json.dump(2) + "\n");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
