// Every program ends with status 2, and a sentence that names the option, when a number is out of its range or an
// option would be ignored: refused_options FOLDER_OF_PROGRAMS [torch]
#include <array>
#include <cstdio>
#include <cstring>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

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
  std::string name, type;  // INT, UINT or FLOAT
  std::size_t values = 1;
  bool has_range = false;
};

/// The options of --help that take numbers, with what stands behind their type.
std::vector<NumberOption> number_options(const std::string& help) {
  // "  --steps INT:1..100000 ", "  --cfg-interval FLOAT:0..1 x 2 "
  const std::regex pattern("^\\s+(--[a-z-]+) (INT|UINT|FLOAT)(\\S*)( x ([0-9]+))?");
  std::vector<NumberOption> options;
  std::istringstream lines(help);
  for (std::string line; std::getline(lines, line);) {
    std::smatch found;
    if (!std::regex_search(line, found, pattern)) continue;
    const std::string range = found[3];
    options.push_back({found[1], found[2], found[5].matched ? std::stoul(found[5]) : 1,
                       std::regex_search(range, std::regex("^:(>=?|[0-9.e+-]+\\.\\.)"))});
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

  /// Each option of a program that takes a number has a range, and refuses what lies outside.
  std::size_t number_ranges(const std::string& program) {
    const Outcome help = run(anigen::test::quoted(folder_) + "/" + program + " --help");
    expect(help.status == 0, program, "--help failed", help);
    const std::vector<NumberOption> options = number_options(help.text);
    for (const NumberOption& option : options) {
      const std::string name = program + " " + option.name;
      expect(option.has_range, name, "its type in --help has no range", {});
      std::string command = name;
      for (std::size_t i = 0; i < option.values; ++i) command += option.type == "FLOAT" ? " nan" : " -99";
      refuses(command, {option.name + ": '", option.type == "FLOAT" ? "not a finite number " : "not a whole number "});
    }
    return options.size();
  }

  std::size_t checked() const { return checked_; }
  std::size_t failed() const { return failed_; }

 private:
  std::string folder_;
  std::size_t checked_ = 0, failed_ = 0;
};

void check_numbers(Check& check, bool torch) {
  std::vector<std::string> programs{"anigen-inspect", "anigen-prepare",    "anigen-prepare merge", "anigen-eval",
                                    "anigen-rig",     "anigen-experiment", "anigen-experiment run"};
  if (torch) {
    programs.insert(programs.end(), {"anigen-train", "anigen-generate", "anigen-encode", "anigen-encode reconstruct"});
  }
  std::size_t options = 0;
  for (const std::string& program : programs) options += check.number_ranges(program);
  require(options > 50, "only " + std::to_string(options) + " options with numbers were found in --help");

  // Messages for the reader, and values that once were taken for others.
  const std::string at_least_0 = "is not a whole number of at least 0";
  check.refuses("anigen-prepare --out x --procedural -5",
                {"--procedural: '-5' is not a whole number from 0 to 10000000"});
  check.refuses("anigen-prepare --out x --procedural 1e3", {"--procedural: '1e3' is not a whole number"});
  check.refuses("anigen-prepare --out x --procedural 99999999999999999999", {"--procedural: "});
  check.refuses("anigen-prepare --out x --test-count -1", {"--test-count: '-1' " + at_least_0});
  check.refuses("anigen-prepare --out x --seed -1", {"--seed: '-1' " + at_least_0});
  check.refuses("anigen-prepare --out x --pose-angle inf",
                {"--pose-angle: 'inf' is not a finite number from 0 to 180"});
  check.refuses("anigen-prepare --out x --device gpu", {"--device: 'gpu' is none of cpu, cuda and cuda:N"});
  check.refuses("anigen-prepare --out x --log-level loud", {"--log-level: "});
  check.refuses("anigen-rig --method heat --mesh a.glb --out b.glb --influences -1",
                {"--influences: '-1' is not a whole number from 0 to 1024"});
  check.refuses("anigen-eval --pred a --gt b --out c --icp-trim 0",
                {"--icp-trim: '0' is not a finite number above 0 and at most 1"});
  if (!torch) return;
  check.refuses("anigen-generate --image a.png --output x --joint-level -3",
                {"--joint-level: '-3' is not a whole number from 0 to 4"});
  check.refuses("anigen-generate --image a.png --output x --steps 0",
                {"--steps: '0' is not a whole number from 1 to 100000"});
  check.refuses("anigen-generate --image a.png --output x --cfg-scale -5",
                {"--cfg-scale: '-5' is not a finite number from 0 to 1000"});
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

void check_ignored(Check& check, bool torch) {
  const std::string data = "anigen-prepare --out x --procedural 1 ";
  check.refuses("anigen-inspect a.glb --seed 3", {"--seed: this program draws nothing at random"});
  check.refuses("anigen-inspect a.glb --device cpu", {"--device: this program uses the CPU"});
  check.refuses("anigen-inspect a.glb --axes published", {"--axes", "--export"});
  check.refuses("anigen-inspect a.glb --influences 8", {"--influences", "--export", "--influence-loss"});
  check.refuses(data + "--view-size 64", {"--view-size", "--views"});
  check.refuses(data + "--cond-cameras front", {"--cond-cameras", "--cond-views"});
  check.refuses(data + "--views 2 --cond-view-size 64", {"--cond-view-size"});
  check.refuses(data + "--view-geometry", {"--view-geometry"});
  check.refuses(data + "--pose-angle 20", {"--pose-angle", "--augment"});
  check.refuses(data + "--device cuda", {"--device", "--features"});
  check.refuses(data + "--features surface --views 2 --feature-weights w.pth", {"--feature-weights"});
  check.refuses(data + "--steps import,skeleton --resolution 32", {"--resolution", "voxels"});
  check.refuses(data + "--steps import --views 3", {"--views", "--steps"});
  check.refuses(data + "--steps import --cond-views 3", {"--cond-views", "--steps"});
  // Numbers of 0 say that nothing is wanted, which their options may go with: the refused one is the shard.
  check.refuses(data +
                    "--views 0 --view-size 64 --cond-views 0 --cond-cameras front --augment 0 --pose-angle 20 "
                    "--view-geometry --shard 9/3",
                {"--shard"});
  // Steps make what they need: features of a network need views.
  check.refuses(
      data + "--steps features --features dinov2_vits14_reg --feature-weights w.pth --view-size 64 --shard 9/3",
      {"--shard"});
  check.refuses(data + "--steps import --no-assets", {"--no-assets", "--steps"});
  check.refuses(data + "--steps import --features surface", {"--features", "--steps"});
  check.refuses("anigen-prepare merge --out x --seed 1", {"--seed: this program"});

  const std::string rig = "anigen-rig --mesh a.glb --out b.glb --method ";
  check.refuses(rig + "heat --device cpu", {"--device", "--method heat", "CPU"});
  check.refuses(rig + "geovoxel --seed 1", {"--seed", "--method geovoxel"});
  check.refuses(rig + "heat --resolution 64", {"--resolution", "geovoxel"});
  check.refuses(rig + "geovoxel --skin heat --falloff 0.5", {"--falloff", "heat"});
  check.refuses(rig + "nearest --influences 2", {"--influences", "nearest"});
  check.refuses(rig + "heat --most-joints 20", {"--most-joints", "curve"});
  check.refuses(rig + "heat --template biped", {"--template", "pinocchio"});
  check.refuses(rig + "pinocchio --template biped --skeleton s.glb", {"--template", "--skeleton"});
  check.refuses(rig + "curve --skeleton s.glb", {"--skeleton", "--method curve"});
  check.refuses(rig + "heat --dataset d", {"--dataset", "template"});
  check.refuses(rig + "heat --image a.png", {"--image", "retrieval"});
  check.refuses(rig + "heat --points 100", {"--points", "anymate"});
  check.refuses(rig + "anymate --eps 0.1", {"--eps", "--joint-model"});
  check.refuses("anigen-rig --method retrieval --image a.png --dataset d --out o --mesh a.glb",
                {"--mesh", "--method retrieval"});
  check.refuses("anigen-rig --method retrieval --image a.png --dataset d --out o --most 3",
                {"--most", "--picture-split"});

  const std::string shapes = "anigen-eval --pred a --gt b --out c ";
  check.refuses(shapes + "--no-icp --rotations 3", {"--rotations", "--no-icp"});
  check.refuses(shapes + "--steps 3", {"--steps", "--ss-flow"});
  check.refuses(shapes + "--device cpu", {"--device", "--ss-flow"});
  check.refuses(shapes + "--metrics skeleton --image-size 64", {"--image-size", "--metrics"});
  check.refuses(shapes + "--metrics skeleton --poses 3", {"--poses", "--metrics"});
  check.refuses(shapes + "--no-report --pictures 3", {"--pictures", "--no-report"});
  check.refuses(shapes + "--no-resume --accept-other-code", {"--accept-other-code", "--no-resume"});
  check.refuses("anigen-eval --gt b --out c --surface-samples 3", {"--surface-samples", "--pred"});
  check.refuses("anigen-eval --gt b --out c --seed 3", {"--seed"});
  check.refuses("anigen-eval --ss-flow a --gt b --out c --json", {"--json", "metrics.json"});
  check.refuses("anigen-experiment run x.json --seed 3", {"--seed: this program"});
  check.refuses("anigen-experiment run x.json --together", {"--together", "--only"});
  if (!torch) return;
  check.refuses("anigen-encode ss --run a --data b --seed 3", {"--seed: this program"});
  check.refuses("anigen-encode ss --run a --data b --again --accept-other-code", {"--accept-other-code", "--again"});
  check.refuses("anigen-train --output x --json", {"--json: this program"});
  check.refuses("anigen-train --output x --restarts 3", {"--restarts", "--ranks"});
  check.refuses("anigen-train --output x --ranks 1 --restarts 3", {"--restarts", "--ranks"});
  check.refuses("anigen-train --output x --communication bf16", {"--communication", "--ranks"});

  const std::string generate = "anigen-generate --output x --ss-flow a --slat-flow b ";
  const std::string picture = generate + "--image a.png ";
  check.refuses(picture + "--checkpoint c", {"--checkpoint", "--ss-flow"});
  check.refuses(picture + "--matting-mean 0.5,0.5,0.5", {"--matting-mean", "--matting-network"});
  check.refuses(picture + "--background keep --matting-network m.onnx", {"--matting-network", "--background keep"});
  check.refuses(picture + "--normal-weights w.pt", {"--normal-weights", "--normals estimator"});
  check.refuses(picture + "--normals flat --normal-map n.png", {"--normal-map", "--normals flat"});
  check.refuses(generate + "--dataset d --normal-map n.png", {"--normal-map", "--dataset"});
  check.refuses(picture + "--cfg-scale 0 --cfg-interval 0.2 0.8", {"--cfg-interval", "--cfg-scale 0"});
  check.refuses(picture + "--keep-hidden --hidden-views 12", {"--hidden-views", "--keep-hidden"});
  check.refuses(picture + "--no-smooth-skin --smooth-alpha 0.5", {"--smooth-alpha", "--no-smooth-skin"});
  check.refuses(picture + "--again --accept-other-code", {"--accept-other-code", "--again"});
}

}  // namespace

int main(int argc, char** argv) {
  try {
    require(argc >= 2, "usage: refused_options FOLDER_OF_PROGRAMS [torch]");
    const bool torch = argc > 2 && std::strcmp(argv[2], "torch") == 0;
    const anigen::test::TemporaryFolder folder;
    require(::chdir(folder.path().c_str()) == 0, "cannot enter " + folder.path().string());
    Check check(argv[1]);
    check_numbers(check, torch);
    check_ignored(check, torch);
    std::printf("%zu of %zu checks failed\n", check.failed(), check.checked());
    return check.failed() == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "FAILED: %s\n", error.what());
    return 1;
  }
}
