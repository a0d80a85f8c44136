// anigen-eval moves two predictions as their ground truth moves: the metric in every file, and pictures.
//   motion_evaluation <anigen-eval>
#include <algorithm>
#include <array>
#include <cstdio>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen;
using namespace anigen::test;

/// A bar of quads along three joints. @param joints with weights: 3, or 1 for a bar that cannot bend
Asset bar(std::int32_t joints) {
  Asset asset;
  constexpr int kRings = 9;
  constexpr std::array<std::array<float, 2>, 4> kCorners = {
      {{-0.05f, -0.05f}, {0.05f, -0.05f}, {0.05f, 0.05f}, {-0.05f, 0.05f}}};
  for (int r = 0; r < kRings; ++r) {
    const float z = 0.125f * static_cast<float>(r);
    for (const auto& [x, y] : kCorners) {
      asset.mesh.vertices.emplace_back(x, y, z);
      asset.skin.append_row({{std::min(static_cast<std::int32_t>(2.0f * z), joints - 1), 1.0f}});
    }
    for (int k = 0; r > 0 && k < 4; ++k) {
      const int a = 4 * r + k, b = 4 * r + (k + 1) % 4;
      asset.mesh.faces.push_back({a, a - 4, b});
      asset.mesh.faces.push_back({b, a - 4, b - 4});
    }
  }
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {0, 0, 0.5}, {0, 0, 1}}, {-1, 0, 1});
  return asset;
}

Animation bend() {
  Channel channel{1, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 1.0}, {0, 0, 0, 1, 0.5, 0, 0, 0.8660254}};
  return {"bend", {channel}};
}

constexpr char kBvh[] =
    "HIERARCHY\nROOT base\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\nJOINT middle\n{\n"
    "OFFSET 0 50 0\nCHANNELS 1 Zrotation\nEnd Site\n{\nOFFSET 0 50 0\n}\n}\n}\n"
    "MOTION\nFrames: 2\nFrame Time: 0.1\n0 90 0 0\n10 90 0 60\n";

double mean(const Json& metrics, const char* method, const char* key) {
  return metrics["methods"][method]["summary"][key]["mean"].get<double>();
}

void run(const std::string& eval) {
  const TemporaryFolder folder;
  Asset truth = bar(3);
  io::write_gltf(folder / "good" / "bar.glb", truth);
  truth.animations = {bend()};
  io::write_gltf(folder / "truth" / "bar.glb", truth);
  io::write_gltf(folder / "stiff" / "bar.glb", bar(1));
  write_file_atomically(folder / "walk.bvh", kBvh);
  const fs::path out = folder / "out";
  const auto evaluate = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {eval,
                                      "--pred",
                                      "good=" + (folder / "good").string(),
                                      "--pred",
                                      "stiff=" + (folder / "stiff").string(),
                                      "--dataset",
                                      (folder / "truth").string(),
                                      "--output",
                                      out.string(),
                                      "--metrics",
                                      "motion",
                                      "--no-icp",
                                      "--motion-frames",
                                      "6",
                                      "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    return run_program(words, folder / "stdout.txt");
  };

  require(evaluate({"--motion-images", "1"}) == 0, "anigen-eval failed");
  Json metrics = read_json(out / "metrics.json");
  require(metrics["assets"][0]["details"]["motion"]["clip"] == "bend", "the truth's own clip was not taken");
  require(mean(metrics, "good", "motion_distance") < 1e-5, "the same rig does not move the same way");
  require(mean(metrics, "stiff", "motion_distance") > 0.02, "a bar that cannot bend is as good as one that can");
  require(mean(metrics, "stiff", "motion_distance_rest") < 1e-5, "equal bars differ at rest");
  require(to_csv(read_csv(out / "metrics.csv")).find("motion_distance") != std::string::npos, "the CSV lacks it");
  require(read_file(out / "table.md").find("motion") != std::string::npos, "the table lacks it");
  require(read_file(out / "report.html").find("data-play") != std::string::npos, "the report does not play");
  std::size_t pictures = 0, rigs = 0;
  for (const auto& entry : fs::recursive_directory_iterator(out / "motion")) {
    pictures += entry.path().extension() == ".png";
    rigs += entry.path().extension() == ".glb";
  }
  require(pictures == 6 && rigs == 3, "not every frame and rig was written");

  require(evaluate({"--motion", (folder / "walk.bvh").string()}) == 0, "anigen-eval --motion failed");
  metrics = read_json(out / "metrics.json");
  require(metrics["assets"][0]["details"]["motion"]["clip"] == "walk", "a saved result of another motion was taken");
  require(mean(metrics, "good", "motion_distance") < 1e-5, "the same rig does not follow the given motion");
  require(mean(metrics, "stiff", "motion_distance") > 0.02, "the given motion moved nothing");
  require(evaluate({"--motion", (folder / "none.bvh").string()}) == 2, "a missing motion is not an error");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: motion_evaluation <anigen-eval>\n");
    return 2;
  }
  try {
    run(argv[1]);
    std::printf("two predictions moved with their truth\n");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "motion_evaluation: %s\n", error.what());
    return 1;
  }
}
