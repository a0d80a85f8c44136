// Every program ends with status 2, and a sentence that names the option, when a number is out of its range or an
// option would be ignored: refused_options FOLDER_OF_PROGRAMS [torch] [mesh], the words for programs that were built
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "tests/e2e/other_program.h"
#include "tests/support/paths.h"

namespace {

using anigen::test::require;

struct Outcome {
  int status = 0;
  std::string text;  // of both streams
};

Outcome run(const std::string& line) {
  std::FILE* pipe = ::popen((line + " 2>&1 </dev/null").c_str(), "r");
  require(pipe != nullptr, "cannot start a shell");
  Outcome outcome;
  std::array<char, 4096> piece{};
  for (std::size_t read = 0; (read = std::fread(piece.data(), 1, piece.size(), pipe)) > 0;)
    outcome.text.append(piece.data(), read);
  const int status = ::pclose(pipe);
  outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

struct NumberOption {
  std::string name, type;  // N: whole, X: any number
  std::size_t values = 1;
  bool has_range = false;
};

/// The options of a command that take numbers. @param program perhaps with the word of a subcommand
std::vector<NumberOption> number_options(const std::string& folder, const std::string& program) {
  const std::string name = program.substr(0, program.find(' '));
  const Outcome outcome = run(anigen::test::quoted(folder) + "/" + name + " --completion json");
  require(outcome.status == 0, name + " --completion json failed: " + outcome.text);
  anigen::Json listing = anigen::Json::parse(outcome.text);
  if (name != program) {
    for (const anigen::Json& command : anigen::Json(listing["commands"]))
      if (name + " " + command["name"].get<std::string>() == program) listing = command;
  }
  std::vector<NumberOption> options;
  for (const anigen::Json& option : listing["options"]) {
    const std::string value = option["value"];
    if (value != "N" && value != "X" && value != "X X" && value != "SECONDS") continue;
    options.push_back({option["name"], value, value == "X X" ? 2U : 1U, option.contains("range")});
  }
  return options;
}

class Check {
 public:
  explicit Check(std::string folder) : folder_(std::move(folder)) {}

  void expect(bool ok, const std::string& command, const std::string& what, const Outcome& outcome) {
    ++checked_;
    if (ok) return;
    ++failed_;
    std::fprintf(stderr, "FAILED %s: %s\n  status %d: %s\n", command.c_str(), what.c_str(), outcome.status,
                 outcome.text.substr(0, 400).c_str());
  }

  /// Status 2, and all these words in what is said. @param command without its folder
  void refuses(const std::string& command, const std::vector<std::string>& words) {
    const Outcome outcome = run(anigen::test::quoted(folder_) + "/" + command);
    expect(outcome.status == 2, command, "status 2 expected", outcome);
    for (const std::string& word : words)
      expect(outcome.text.find(word) != std::string::npos, command, "no '" + word + "' in what it says", outcome);
  }

  /// Status 0, and nothing said.
  void accepts(const std::string& command) {
    const Outcome outcome = run(anigen::test::quoted(folder_) + "/" + command);
    expect(outcome.status == 0 && outcome.text.empty(), command, "status 0 and no word expected", outcome);
  }

  /// Each option of a program that takes a number has a range, and refuses what lies outside.
  std::size_t number_ranges(const std::string& program) {
    const Outcome help = run(anigen::test::quoted(folder_) + "/" + program + " --help");
    expect(help.status == 0, program, "--help failed", help);
    const std::vector<NumberOption> options = number_options(folder_, program);
    for (const NumberOption& option : options)
      expect(help.text.find(option.name) != std::string::npos, program, option.name + " is not in --help", help);
    for (const NumberOption& option : options) {
      const std::string name = program + " " + option.name;
      expect(option.has_range, name, "it has no range", {});
      std::string command = name;
      for (std::size_t i = 0; i < option.values; ++i) command += option.type != "N" ? " nan" : " -99";
      refuses(command, {option.name + ": '", option.type != "N" ? "not a finite number " : "not a whole number "});
    }
    return options.size();
  }

  const std::string& folder() const { return folder_; }
  std::size_t checked() const { return checked_; }
  std::size_t failed() const { return failed_; }

 private:
  std::string folder_;
  std::size_t checked_ = 0, failed_ = 0;
};

void check_numbers(Check& check, bool torch, bool mesh) {
  std::vector<std::string> programs{"anigen-inspect",    "anigen-prepare",       "anigen-prepare merge",
                                    "anigen-eval",       "anigen-rig",           "anigen-animate",
                                    "anigen-experiment", "anigen-experiment run"};
  if (torch) {
    programs.insert(programs.end(), {"anigen-train", "anigen-generate", "anigen-encode", "anigen-encode reconstruct",
                                     "anigen-encode grouping"});
  }
  if (std::filesystem::exists(std::filesystem::path(check.folder()) / "anigen-studio"))
    programs.emplace_back("anigen-studio");
  if (mesh) {
    programs.insert(programs.end(), {"anigen-mesh check", "anigen-mesh repair", "anigen-mesh wrap",
                                     "anigen-mesh remesh", "anigen-mesh simplify"});
  }
  std::size_t options = 0;
  for (const std::string& program : programs) options += check.number_ranges(program);
  require(options > 50, "only " + std::to_string(options) + " options with numbers were found");

  // Messages for the reader, and values that once were taken for others.
  const std::string at_least_0 = "is not a whole number of at least 0";
  check.refuses("anigen-prepare --output x --procedural -5",
                {"--procedural: '-5' is not a whole number from 0 to 10000000"});
  check.refuses("anigen-prepare --output x --procedural 1e3", {"--procedural: '1e3' is not a whole number"});
  check.refuses("anigen-prepare --output x --procedural 99999999999999999999", {"--procedural: "});
  check.refuses("anigen-prepare --output x --test-count -1", {"--test-count: '-1' " + at_least_0});
  check.refuses("anigen-prepare --output x --seed -1", {"--seed: '-1' " + at_least_0});
  check.refuses("anigen-prepare --output x --pose-angle inf",
                {"--pose-angle: 'inf' is not a finite number from 0 to 180"});
  check.refuses("anigen-prepare --output x --device gpu", {"--device: 'gpu' is none of cpu, cuda and cuda:N"});
  check.refuses("anigen-prepare --output x --log-level loud", {"--log-level: "});
  check.refuses("anigen-rig --method heat --mesh a.glb --output b.glb --influences -1",
                {"--influences: '-1' is not a whole number from 0 to 1024"});
  check.refuses("anigen-eval --pred a --dataset b --output c --icp-trim 0",
                {"--icp-trim: '0' is not a finite number above 0 and at most 1"});
  if (!torch) return;
  check.refuses("anigen-generate --image a.png --output x --joint-level -3",
                {"--joint-level: '-3' is not a whole number from 0 to 4"});
  check.refuses("anigen-generate --image a.png --output x --slat-steps 0",
                {"--slat-steps: '0' is not a whole number from 1 to 100000"});
  check.refuses("anigen-generate --image a.png --output x --slat-guidance 0.5",
                {"--slat-guidance: '0.5' is not a finite number from 1 to 1001"});
  for (const char* option : {"--slat-steps 3", "--joints 4", "--texture-size 0", "--obj", "--intermediate"})
    check.refuses(std::string("anigen-generate --image a.png --output x --stop-at voxels ") + option,
                  {"--stop-at voxels ends before it"});
  for (const char* option : {"--ss-steps 3", "--condition color", "--normals flat"})
    check.refuses(std::string("anigen-generate --image a.png --output x --voxels v.npz ") + option,
                  {"applies to stage 4"});
  check.refuses("anigen-generate --image a.png --output x --voxels v.npz --stop-at voxels", {"--voxels"});
  check.refuses("anigen-generate --image a.png --output x --stop-at mesh", {"--stop-at", "voxels"});
  check.refuses("anigen-generate --image a.png --output x --mask m.png --background grabcut", {"--mask says"});
  check.refuses("anigen-generate --image a.png --output x.vrm", {"x.vrm", "anigen-rig makes a .vrm"});
  check.refuses("anigen-generate --image a.png --output x.obj", {"x.obj", "--obj"});
  check.refuses("anigen-generate --image a.png --output x.STL", {"x.STL", ".glb"});
  check.refuses("anigen-generate --image a.png --output x --reduction 1",
                {"--reduction: '1' is not a finite number from 0 to below 1"});
  for (const char* option : {"--matting-mean", "--matting-deviation"}) {
    const std::string generate =
        std::string("anigen-generate --image a.png --output x --matting-network m.onnx ") + option;
    check.refuses(generate + " 0.5,nan,0.5", {std::string(option) + ": 'nan' is not a finite number"});
    check.refuses(generate + " 0.5,0.5", {option});
    check.refuses(generate + " 0.5,0.5,0.5,0.5", {});
  }
  check.refuses("anigen-generate --image a.png --output x --matting-network m.onnx --matting-deviation 0.5,0,0.5",
                {"--matting-deviation: '0' is not a finite number above 0"});
}

void check_mesh_program(Check& check) {
  check.refuses("anigen-mesh", {"A subcommand is required"});
  check.refuses("anigen-mesh remesh a.glb -o b.glb --alpha 0.1", {"--alpha: anigen-mesh has no such option"});
  check.refuses("anigen-mesh remesh a.glb -o b.glb --faces 10 --edge-length 0.1", {"--edge-length", "--faces"});
  check.refuses("anigen-mesh simplify a.glb -o b.glb", {"--faces", "--reduction"});
  check.refuses("anigen-mesh repair a.glb -o b.fbx", {"b.fbx", ".glb", ".stl"});
  check.refuses("anigen-mesh repair a.glb -o b.glb --keep-going", {"--keep-going", "check"});
}

/// --check-options says what the program itself would say, ahead of files that are not there yet.
void check_options_alone(Check& check, bool torch) {
  check.accepts("anigen-rig --check-options --method anymate --mesh a.glb --joint-model later --output b.glb");
  check.refuses("anigen-rig --method anymate --mesh a.glb --joint-model later --output b.glb",
                {"later: --joint-model: there is no such file"});
  check.refuses("anigen-rig --mesh a.glb --output b.glb --method heat --seed 1 --check-options", {"--seed"});
  check.accepts("anigen-prepare --procedural 2 --test-split later.txt --output x --check-options");
  check.refuses("anigen-prepare --check-options --procedural 2 --output x --view-size 64", {"--view-size", "--views"});
  check.refuses("anigen-prepare --check-options --procedural 2 --procedural 3 --output x", {"--procedural"});
  check.accepts("anigen-eval --pred later --dataset later --output x --check-options");
  check.accepts("anigen-animate later.glb --motion walk --output x.glb --check-options");
  check.refuses("anigen-animate later.glb --check-options", {"--output"});
  if (!torch) return;
  check.accepts("anigen-generate --image later.png --output x --check-options");
  check.accepts("anigen-encode ss --run later --dataset later --check-options");
  check.refuses("anigen-encode grouping --dataset later --split later.txt --check-options", {"--run"});
  const std::string config = (anigen::test::source_dir() / "configs/tiny/skin_ae.json").string();
  const std::string train =
      "anigen-train --dataset later --output x --check-options --config " + anigen::test::quoted(config) + " ";
  check.accepts(train);
  check.refuses(train + "--set trainer.args.no_such_key=1", {"skin_ae.json", "no_such_key"});
  check.refuses("anigen-train --output x --check-options --config later.json", {"later.json"});
}

void check_ignored(Check& check, bool torch) {
  const std::string data = "anigen-prepare --output x --procedural 1 ";
  check.refuses("anigen-inspect a.glb --seed 3", {"--seed: anigen-inspect has no such option"});
  check.refuses("anigen-inspect a.glb --device cpu", {"--device: anigen-inspect has no such option"});
  check.refuses("anigen-inspect a.glb --axes published", {"--axes", "--output"});
  check.refuses("anigen-inspect a.glb --lint --output b.png", {"--output", "--lint"});
  check.refuses("anigen-inspect a.glb --lint-level warning", {"--lint-level", "--lint"});
  check.refuses("anigen-inspect a.glb --influences 8", {"--influences", "--output", "--influence-loss"});
  check.refuses(data + "--view-size 64", {"--view-size", "--views"});
  check.refuses(data + "--cond-cameras front", {"--cond-cameras", "--cond-views"});
  check.refuses(data + "--views 2 --cond-view-size 64", {"--cond-view-size"});
  check.refuses(data + "--view-geometry", {"--view-geometry"});
  check.refuses(data + "--pose-angle 20", {"--pose-angle", "--augment"});
  check.refuses(data + "--pose-scale 0.2", {"--pose-scale", "--augment"});
  check.refuses(data + "--key-frames", {"--key-frames", "--augment"});
  check.refuses(data + "--augment 2 --key-frames --random-poses", {"--key-frames", "--random-poses"});
  check.refuses(data + "--augment 2 --key-frames --pose-angle 20", {"--pose-angle", "--key-frames"});
  check.refuses(data + "--device cuda", {"--device", "--features"});
  check.refuses(data + "--features surface --views 2 --feature-weights w.pth", {"--feature-weights"});
  check.refuses(data + "--only import,skeleton --voxel-resolution 32", {"--voxel-resolution", "voxels"});
  check.refuses(data + "--only import --views 3", {"--views", "--only"});
  check.refuses(data + "--only import --cond-views 3", {"--cond-views", "--only"});
  // Numbers of 0 say that nothing is wanted, which their options may go with: the refused one is the shard.
  check.refuses(data +
                    "--views 0 --view-size 64 --cond-views 0 --cond-cameras front --augment 0 --pose-angle 20 "
                    "--view-geometry --shard 9/3",
                {"--shard"});
  // Steps make what they need: features of a network need views.
  check.refuses(
      data + "--only features --features dinov2_vits14_reg --feature-weights w.pth --view-size 64 --shard 9/3",
      {"--shard"});
  check.refuses(data + "--only import --no-assets", {"--no-assets", "--only"});
  check.refuses(data + "--only import --features surface", {"--features", "--only"});
  check.refuses(data + "--shards 3", {"--shards", "--stream"});
  check.refuses(data + "--stream 3", {"--procedural", "--stream"});
  check.refuses("anigen-prepare --output x --stream 2 --test-count 1", {"--test-count", "all for training"});
  check.refuses("anigen-prepare merge --dataset x --seed 1", {"--seed", "merge"});

  const std::string matting = "anigen-eval --matting-network runs/matting --dataset d --output o ";
  check.refuses(matting + "--json", {"--json", "--matting-network"});
  check.refuses(matting + "--pred p", {"--pred"});
  const std::string protocols = "anigen-eval --pred p --dataset d --output o --protocol ";
  check.refuses(protocols + "unirig --no-icp", {"--no-icp", "--protocol unirig"});
  check.refuses(protocols + "unirig --metrics skin", {"--metrics", "--protocol unirig"});
  check.refuses(protocols + "other", {"--protocol", "magicarticulate"});
  check.refuses(matting + "--skin-run r", {"--skin-run"});
  check.refuses("anigen-eval --skin-run r --skin-ae s --dataset d --output o", {"--skin-run", "--skin-ae"});
  check.refuses("anigen-eval --skin-run r --pred p --dataset d --output o", {"--pred", "--skin-run"});
  check.refuses("anigen-eval --pred p --dataset d --output o --backgrounds b", {"--backgrounds", "--matting-network"});
  const std::string rig = "anigen-rig --mesh a.glb --output b.glb --method ";
  check.refuses(rig + "heat --device cpu", {"--device", "--method heat", "CPU"});
  check.refuses(rig + "geovoxel --seed 1", {"--seed", "--method geovoxel"});
  check.refuses(rig + "heat --geovoxel-resolution 64", {"--geovoxel-resolution", "geovoxel"});
  check.refuses(rig + "geovoxel --skin heat --falloff 0.5", {"--falloff", "heat"});
  check.refuses(rig + "nearest --influences 2", {"--influences", "nearest"});
  check.refuses(rig + "heat --curve-joints 20", {"--curve-joints", "curve"});
  check.refuses(rig + "heat --template biped", {"--template", "pinocchio"});
  check.refuses(rig + "heat --new-skeleton", {"--new-skeleton", "auto"});
  check.refuses(rig + "heat --one-body", {"--one-body", "auto"});
  check.refuses(rig + "curve --add-joints", {"--add-joints", "curve"});
  check.refuses(rig + "auto --add-joints --new-skeleton", {"--add-joints", "--new-skeleton"});
  check.refuses(rig + "auto --new-skeleton --skeleton s.glb", {"--new-skeleton", "--skeleton"});
  check.refuses(rig + "auto --seed 1", {"--seed", "auto"});
  check.refuses(rig + "pinocchio --template biped --skeleton s.glb", {"--template", "--skeleton"});
  check.refuses(rig + "curve --skeleton s.glb", {"--skeleton", "--method curve"});
  check.refuses(rig + "heat --dataset d", {"--dataset", "template"});
  check.refuses(rig + "heat --format obj", {"--format", "glb", "usdz"});
  check.refuses(rig + "heat --skin none --no-graft", {"--no-graft", "skeleton alone"});
  check.refuses(rig + "heat --skin-run .", {"--skin-run", "--skin learned"});
  check.refuses(rig + "heat --skin learned --falloff 0.5", {"--falloff", "learned"});
  check.refuses(rig + "anymate --skin-model . --skin learned", {"--skin", "--skin-model"});
  check.refuses(rig + "anigen --skeleton s.glb", {"--skeleton", "--method anigen"});
  check.refuses(rig + "anigen --skin-model .", {"--skin-model", "anymate"});
  check.refuses(rig + "heat --joint-model .", {"--joint-model", "anigen"});
  check.refuses(rig + "heat --image a.png", {"--image", "retrieval"});
  check.refuses(rig + "heat --points 100", {"--points", "anymate"});
  check.refuses(rig + "heat --author A", {"--author", ".vrm"});
  check.refuses(rig + "heat --copyright C", {"--copyright", ".vrm"});
  check.refuses(rig + "heat --height 0", {"--height", "above 0"});
  check.refuses(rig + "heat --bone-axes up", {"--bone-axes", "along"});
  check.refuses(rig + "heat --names blender", {"--names", "unreal"});
  check.refuses("anigen-rig --mesh a.glb --output b.glb --rigid-share 0.8", {"--rigid-share", "--rigid-parts"});
  check.refuses("anigen-rig --mesh a.glb --output b.glb --skin none --rigid-parts",
                {"--rigid-parts", "skeleton alone"});
  check.refuses("anigen-rig --mesh a.glb --output b.vrm --skin none", {"--skin none", ".vrm"});
  check.refuses("anigen-rig --method retrieval --image a.png --dataset d --output o --ground",
                {"--ground", "retrieval"});
  check.refuses(rig + "anymate --joint-distance 0.1", {"--joint-distance", "--joint-model"});
  check.refuses("anigen-rig --method retrieval --image a.png --dataset d --output o --mesh a.glb",
                {"--mesh", "--method retrieval"});
  const std::string retrieval = "anigen-rig --method retrieval --dataset d --output o ";
  check.refuses(retrieval + "--image a.png --no-graft", {"--no-graft", "--method retrieval"});
  check.refuses(retrieval + "--image a.png --limit 3", {"--limit", "--image-split"});
  check.refuses(retrieval + "--image a.png --device cpu", {"--device", "--retrieval-encoder"});
  check.refuses(retrieval + "--image-split t.txt --retrieval-encoder r --condition color",
                {"--condition", "--retrieval-encoder"});

  check.refuses("anigen-animate a.glb", {"--output", "--list"});
  check.refuses("anigen-animate a.glb --list --speed 2", {"--speed", "--list"});
  check.refuses("anigen-animate a.glb --output b.glb --frames 9 --fps 12", {"--fps", "--frames"});
  check.refuses("anigen-animate a.glb --output b.glb --pose A", {"--pose"});
  check.refuses("anigen-animate a.glb --output b.glb --pose T --speed 2", {"--speed", "--pose"});
  check.refuses("anigen-animate a.glb --output b.glb --motion wag --travel", {"--travel", "walk"});
  check.refuses("anigen-animate a.glb --output b.glb --video frames --motion walk", {"--motion", "--video"});
  check.refuses("anigen-animate a.glb --output b.glb --background keep", {"--background", "--video"});
  check.refuses("anigen-animate a.glb --list --video frames", {"--video", "--list"});
  check.refuses("anigen-animate a.glb --output b.glb --seed 1", {"--seed: anigen-animate has no such option"});

  const std::string shapes = "anigen-eval --pred a --dataset b --output c ";
  check.refuses(shapes + "--no-icp --rotations 3", {"--rotations", "--no-icp"});
  check.refuses(shapes + "--ss-steps 3", {"--ss-steps", "--ss-flow"});
  check.refuses(shapes + "--device cpu", {"--device", "--ss-flow"});
  check.refuses(shapes + "--metrics skeleton --image-size 64", {"--image-size", "--metrics"});
  check.refuses(shapes + "--metrics skeleton --poses 3", {"--poses", "--metrics"});
  check.refuses(shapes + "--no-report --report-images 3", {"--report-images", "--no-report"});
  check.refuses(shapes + "--force --accept-other-code", {"--accept-other-code", "--force"});
  check.refuses("anigen-eval --dataset b --output c --surface-samples 3", {"--surface-samples", "--pred"});
  check.refuses("anigen-eval --dataset b --output c --seed 3", {"--seed"});
  check.refuses("anigen-eval --ss-flow a --dataset b --output c --json", {"--json", "metrics.json"});
  const std::string oracle = "anigen-eval --oracle --dataset b --output c --ss-flow a ";
  check.refuses(oracle, {"--slat-flow", "--oracle"});
  check.refuses(oracle + "--slat-flow d --pred e", {"--oracle", "predictions"});
  check.refuses(oracle + "--slat-flow d --retrieval-views 2", {"--retrieval-views", "--oracle"});
  check.refuses(oracle + "--slat-flow d --ss-guidance 2,3", {"--ss-guidance", "one"});
  check.refuses(shapes + "--slat-steps 3", {"--slat-steps", "--oracle"});
  check.refuses(shapes + "--cluster-algorithm paper", {"--cluster-algorithm", "--oracle"});
  check.refuses(oracle + "--slat-flow d --cluster-algorithm printed", {"--cluster-algorithm", "paper"});
  check.refuses("anigen-experiment run x.json --seed 3", {"--seed: anigen-experiment has no such option"});
  check.refuses("anigen-experiment run x.json --together", {"--together", "--only"});
  check.refuses("anigen-inspect a.glb --output b.txt", {"b.txt", ".png", ".glb"});
  check.refuses("anigen-inspect a.glb -o b.png -o c.png", {"c.png", "one image"});
  check.refuses("anigen-prepare --procedural 1", {"--output"});
  check.refuses("anigen-eval --predd a -o c", {"--predd: anigen-eval has no such option; did you mean --pred?"});
  // Names of 0.1 reach today's options.
  check.refuses("anigen-prepare --out x --resolution 1", {"--voxel-resolution: '1' is not a whole number"});
  check.refuses("anigen-eval --gt a --out b --guidance -5", {"--ss-guidance: '-4' is not a finite number"});
  if (!torch) return;
  check.refuses("anigen-encode ss --run a --dataset b --seed 3", {"--seed: anigen-encode has no such option"});
  check.refuses("anigen-encode ss --run a --dataset b --force --accept-other-code", {"--accept-other-code", "--force"});
  check.refuses("anigen-train --output x --json", {"--json: anigen-train has no such option"});
  check.refuses("anigen-train --output x --rank-restarts 3", {"--rank-restarts", "--ranks"});
  check.refuses("anigen-train --output x --ranks 1 --rank-restarts 3", {"--rank-restarts", "--ranks"});
  check.refuses("anigen-train --config x", {"--output"});
  check.refuses("anigen-generate --output x --cfg-scale -5", {"--slat-guidance: '-4' is not a finite number"});
  check.refuses("anigen-train --output x --communication bf16", {"--communication", "--ranks"});

  const std::string generate = "anigen-generate --output x --ss-flow a --slat-flow b ";
  const std::string picture = generate + "--image a.png ";
  check.refuses(picture + "--runs c", {"--runs", "--ss-flow"});
  check.refuses(picture + "--matting-mean 0.5,0.5,0.5", {"--matting-mean", "--matting-network"});
  check.refuses(picture + "--background keep --matting-network m.onnx", {"--matting-network", "--background keep"});
  check.refuses(picture + "--matting-network . --matting-mean 0.5,0.5,0.5", {"--matting-mean", "is a trained run"});
  check.refuses(picture + "--matting-network . --matting-deviation 0.5,0.5,0.5",
                {"--matting-deviation", "is a trained run"});
  check.refuses(picture + "--normal-weights w.pt", {"--normal-weights", "--normals estimator"});
  check.refuses(picture + "--normals flat --normal-map n.png", {"--normal-map", "--normals flat"});
  check.refuses(generate + "--dataset d --normal-map n.png", {"--normal-map", "--dataset"});
  check.refuses(picture + "--slat-guidance 1 --slat-interval 0.2 0.8", {"--slat-interval", "--slat-guidance 1"});
  check.refuses(picture + "--keep-hidden --hidden-views 12", {"--hidden-views", "--keep-hidden"});
  check.refuses(picture + "--no-smooth-skin --smooth-alpha 0.5", {"--smooth-alpha", "--no-smooth-skin"});
  check.refuses(picture + "--view-rule stochastic", {"--view-rule", "--one-object"});
  check.refuses(picture + "--one-object", {"--one-object", "two images"});
  check.refuses(picture + "--image b.png --one-object --normal-map n.png", {"--normal-map", "one image"});
  check.refuses(generate + "--one-object --dataset d --split s", {"--one-object"});
  check.refuses(picture + "--image-views 2", {"--image-views", "--dataset"});
  check.refuses(picture + "--rigid-share 0.8", {"--rigid-share", "--rigid-parts"});
  check.refuses(picture + "--force --accept-other-code", {"--accept-other-code", "--force"});
}

}  // namespace

int main(int argc, char** argv) {
  try {
    require(argc >= 2, "usage: refused_options FOLDER_OF_PROGRAMS [torch] [mesh]");
    const auto given = [&](const char* word) {
      return std::any_of(argv + 2, argv + argc, [&](const char* other) { return std::strcmp(other, word) == 0; });
    };
    const bool torch = given("torch"), mesh = given("mesh");
    const anigen::test::TemporaryFolder folder;
    require(::chdir(folder.path().c_str()) == 0, "cannot enter " + folder.path().string());
    Check check(argv[1]);
    check_numbers(check, torch, mesh);
    check_options_alone(check, torch);
    check_ignored(check, torch);
    if (mesh) check_mesh_program(check);
    std::printf("%zu of %zu checks failed\n", check.failed(), check.checked());
    return check.failed() == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "FAILED: %s\n", error.what());
    return 1;
  }
}
