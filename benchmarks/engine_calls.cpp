// Seconds of calls of the engine, for benchmarks/python_calls.py, which times the same calls from Python.
//   benchmark_engine_calls ASSET.glb
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <functional>
#include <vector>

#include "anigen/anigen.h"

namespace {

/// Median seconds of a call, of nine after one that warms up.
double seconds_of(const std::function<void()>& call) {
  call();
  std::vector<double> seconds;
  for (int i = 0; i < 9; ++i) {
    const auto started = std::chrono::steady_clock::now();
    call();
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
  }
  std::nth_element(seconds.begin(), seconds.begin() + 4, seconds.end());
  return seconds[4];
}

}  // namespace

int main(int argc, char** argv) try {
  using namespace anigen;
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s ASSET.glb\n", argv[0]);
    return 2;
  }
  const Asset asset = engine::load(argv[1]);
  engine::RigOptions heat;
  heat.method = "heat";
  const JointTree tree = joint_tree(asset.skeleton);
  engine::EvaluateOptions options;
  options.groups = {"skeleton", "transport", "skin"};
  options.registration = false;
  std::printf("rig %.6f\n", seconds_of([&] { engine::rig(asset, heat); }));
  std::printf("gromov_wasserstein %.6f\n", seconds_of([&] { engine::gromov_wasserstein(tree, tree); }));
  std::printf("evaluate %.6f\n", seconds_of([&] { engine::evaluate(asset, asset, options); }));
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}
