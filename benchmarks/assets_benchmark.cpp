// Time to import real files and to make procedural ones. Import is timed beside the same file going through bare
// tinygltf, which parses but neither checks nor skins anything.
#include <benchmark/benchmark.h>
#include <tiny_gltf.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "anigen/io/gltf/gltf.h"

namespace {

namespace fs = std::filesystem;

void import_ours(benchmark::State& state, const fs::path& file) {
  for (auto _ : state) benchmark::DoNotOptimize(anigen::io::read_gltf(file));
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(fs::file_size(file)));
}

void import_tinygltf(benchmark::State& state, const fs::path& file) {
  for (auto _ : state) {
    tinygltf::TinyGLTF loader;
    // Pictures stay encoded in both.
    loader.SetImageLoader([](tinygltf::Image*, int, std::string*, std::string*, int, int, const unsigned char*, int,
                             void*) { return true; },
                          nullptr);
    tinygltf::Model model;
    std::string error, warning;
    const bool ok = file.extension() == ".glb" ? loader.LoadBinaryFromFile(&model, &error, &warning, file.string())
                                               : loader.LoadASCIIFromFile(&model, &error, &warning, file.string());
    if (!ok) state.SkipWithError(error.c_str());
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(fs::file_size(file)));
}

void make_creatures(benchmark::State& state, const std::string& family) {
  std::uint64_t index = 0;
  for (auto _ : state) benchmark::DoNotOptimize(anigen::creatures::make_creature(family, 0, index++));
  state.counters["assets_per_second"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

void make_mixed_creatures(benchmark::State& state) {
  constexpr std::size_t kBatch = 24;
  anigen::set_thread_count(static_cast<int>(state.range(0)));
  std::uint64_t first = 0;
  for (auto _ : state) {
    anigen::parallel_for(
        kBatch, [&](std::size_t i) { benchmark::DoNotOptimize(anigen::creatures::make_creature(0, first + i)); });
    first += kBatch;
  }
  state.counters["assets_per_second"] =
      benchmark::Counter(static_cast<double>(state.iterations() * kBatch), benchmark::Counter::kIsRate);
}

}  // namespace

int main(int argc, char** argv) {
  const char* folder = std::getenv("ANIGEN_ASSETS_DIR");
  const fs::path root = folder != nullptr ? fs::path(folder) : fs::path("../shared/assets");
  for (const char* name : {"humanoid/kaykit_knight.glb", "humanoid/lumberjack.glb", "humanoid/cesium_man.gltf",
                           "creature/dcl_octopus_npc.glb", "synthetic/tentacle_84_skins.glb"}) {
    const fs::path file = root / "rigged" / name;
    if (!fs::exists(file)) continue;
    const std::string stem = file.stem().string();
    benchmark::RegisterBenchmark(("import/anigen/" + stem).c_str(), import_ours, file)->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("import/tinygltf/" + stem).c_str(), import_tinygltf, file)
        ->Unit(benchmark::kMillisecond);
  }
  for (const std::string& family : anigen::creatures::creature_families())
    benchmark::RegisterBenchmark(("creature/" + family).c_str(), make_creatures, family)->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("creatures/threads", make_mixed_creatures)
      ->Arg(1)
      ->Arg(2)
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond);
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
