// Programs and library give the same for the same options: library_and_programs FOLDER_OF_PROGRAMS [WEIGHTS IMAGE]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "anigen/anigen.h"
#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "tests/e2e/other_program.h"
#include "tests/support/dataset_files.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen;
using test::require;

class Comparison {
 public:
  explicit Comparison(fs::path programs) : programs_(std::move(programs)) {
    for (const char* whose : {"program", "library"}) fs::create_directories(folder_ / whose);
    dog_.name = "dog";
    engine::save(dog_, dog());
    Asset mesh = dog_;
    mesh.skeleton = {};
    mesh.skin = {};
    mesh.animations.clear();
    engine::save(mesh, mesh_alone());
  }

  fs::path dog() const { return folder_ / "dog.glb"; }
  fs::path mesh_alone() const { return folder_ / "mesh.glb"; }
  fs::path of_program(const std::string& name) const { return folder_ / "program" / name; }
  fs::path of_library(const std::string& name) const { return folder_ / "library" / name; }

  /// @param words of its command line @throws std::runtime_error unless it succeeds
  void run(const std::string& program, const std::vector<std::string>& words) const {
    std::string line = test::quoted(programs_ / program) + " --quiet";
    for (const std::string& word : words) line += " " + test::quoted(word);
    require(test::run_program(line + " >/dev/null") == 0, line);
  }

  void rigs(const std::string& name, const fs::path& mesh, std::vector<std::string> words,
            const engine::RigOptions& options) const {
    const std::string file = name + ".glb";
    words.insert(words.end(), {"--mesh", mesh.string(), "--output", of_program(file).string()});
    run("anigen-rig", words);
    engine::rig_file(mesh, of_library(file), options);
    require(read_file(of_program(file)) == read_file(of_library(file)), "the rigs " + name + " differ");
  }

 private:
  test::TemporaryFolder folder_;
  fs::path programs_;
  Asset dog_ = creatures::make_creature("quadruped", 3, 0);
};

void compare_rigs(const Comparison& comparison) {
  engine::RigOptions curve;
  curve.method = "curve";
  curve.joints = 14;
  curve.symmetric = true;
  comparison.rigs("curve", comparison.mesh_alone(), {"--method", "curve", "--joints", "14", "--symmetric"}, curve);
  engine::RigOptions automatic;
  automatic.keep_skeleton = automatic.separate_bodies = false;
  automatic.templates = {"fox"};
  automatic.influences = 2;
  comparison.rigs("automatic", comparison.dog(),
                  {"--new-skeleton", "--one-body", "--template", "fox", "--influences", "2"}, automatic);
  engine::RigOptions game;
  game.method = "heat";
  game.rigid_share = 0.7;
  game.bone_axes = "along";
  game.names = "chain";
  game.height = 1.8;
  game.ground = game.root_bone = true;
  comparison.rigs("game", comparison.dog(),
                  {"--method", "heat", "--rigid-parts", "--bone-axes", "along", "--names", "chain", "--height", "1.8",
                   "--ground", "--root-bone"},
                  game);
}

bool are_near(const Animation& a, const Animation& b, const Skeleton& skeleton) {
  if (a.name != b.name || std::abs(a.duration() - b.duration()) > 1e-6) return false;
  for (const double share : {0.0, 0.3, 0.8}) {
    const Pose of_a = sample(a, skeleton, share * a.duration()), of_b = sample(b, skeleton, share * a.duration());
    for (std::size_t j = 0; j < of_a.size(); ++j)
      if (!of_a[j].matrix().isApprox(of_b[j].matrix(), 1e-5)) return false;
  }
  return true;
}

void compare_clips(const Comparison& comparison) {
  const fs::path file = comparison.of_program("clips.glb");
  comparison.run("anigen-animate", {comparison.dog().string(), "--motion", "walk", "--motion", "wag", "--frames", "20",
                                    "--speed", "1.5", "--travel", "--drop-clips", "--output", file.string()});
  engine::AnimateOptions options;
  options.motions = {"walk", "wag"};
  options.frames = 20;
  options.speed = 1.5;
  options.travel = true;
  Asset dog = engine::load(comparison.dog());
  dog.animations.clear();  // as --drop-clips: names are told apart from those of clips that stay
  const std::vector<Animation> clips = engine::animate(dog, options);
  const Asset animated = engine::load(file);
  require(animated.animations.size() == clips.size(), "the program made another number of clips");
  for (std::size_t i = 0; i < clips.size(); ++i)
    require(are_near(animated.animations[i], clips[i], animated.skeleton), "the clips " + clips[i].name + " differ");
  comparison.run("anigen-animate", {comparison.dog().string(), "--drop-clips", "--output", file.string()});
  const Asset idle = engine::load(file);
  require(are_near(idle.animations.at(0), engine::animate(dog).at(0), idle.skeleton), "the clips of no options differ");
}

void compare_scores(const Comparison& comparison, const std::vector<std::string>& words,
                    const engine::EvaluateOptions& options) {
  const fs::path predicted = comparison.of_library("curve.glb"), results = comparison.of_program("scores");
  std::vector<std::string> all = {"--pred",   predicted.string(), "--dataset", comparison.dog().string(),
                                  "--output", results.string(),   "--force",   "--no-report"};
  all.insert(all.end(), words.begin(), words.end());
  comparison.run("anigen-eval", all);
  const Json of_program = read_json(results / "metrics.json").at("assets").at(0);
  const engine::Scores scores = engine::evaluate(engine::load(predicted), engine::load(comparison.dog()), options);
  std::size_t compared = 0;
  for (const auto& [key, value] : of_program.items()) {
    if (!value.is_number() || key == "seconds") continue;
    ++compared;
    require(scores.values.count(key) > 0, "the library lacks " + key);
    const double a = value.get<double>(), b = scores.values.at(key);
    require(std::abs(a - b) <= 1e-9 * std::max(1.0, std::abs(a)),
            key + " of the program is " + std::to_string(a) + ", of the library " + std::to_string(b));
  }
  require(compared > 3 && compared + scores.values.count("seconds") == scores.values.size(), "other metrics");
}

void compare_all_scores(const Comparison& comparison) {
  engine::EvaluateOptions options;
  options.groups = {"skeleton", "skin", "surface"};
  options.merge_joints = 0.02;
  options.visible_surface = true;
  options.surface_samples = 2000;
  options.seed = 5;
  compare_scores(comparison,
                 {"--metrics", "skeleton,skin,surface", "--merge-joints", "0.02", "--visible-surface",
                  "--surface-samples", "2000", "--seed", "5"},
                 options);
  options = {};
  options.groups = {"skeleton", "transport"};
  options.normalization = "truth";
  options.registration = false;
  compare_scores(comparison, {"--metrics", "skeleton,transport", "--normalize", "truth", "--no-icp"}, options);
  options = {};
  options.protocol = "unirig";
  compare_scores(comparison, {"--protocol", "unirig"}, options);
}

/// @param with_features those of voxels, which need LibTorch
void compare_datasets(const Comparison& comparison, bool with_features) {
  const fs::path of_program = comparison.of_program("data"), of_library = comparison.of_library("data");
  std::vector<std::string> words = {"--input",
                                    comparison.dog().string(),
                                    "--procedural",
                                    "2",
                                    "--augment",
                                    "1",
                                    "--clean",
                                    "articulation-xl",
                                    "--no-assets",
                                    "--view-geometry",
                                    "--voxel-resolution",
                                    "16",
                                    "--views",
                                    "2",
                                    "--view-size",
                                    "16",
                                    "--cond-views",
                                    "2",
                                    "--cond-view-size",
                                    "32",
                                    "--cond-cameras",
                                    "front",
                                    "--test-fraction",
                                    "0",
                                    "--seed",
                                    "9",
                                    "--output",
                                    of_program.string()};
  if (with_features) words.insert(words.end(), {"--features", "surface"});
  comparison.run("anigen-prepare", words);
  engine::PrepareOptions options;
  options.creatures = 2;
  options.poses = 1;
  options.cleaning = "articulation-xl";
  options.keep_assets = false;
  options.resolution = 16;
  options.views = options.condition_views = 2;
  options.view_size = 16;
  options.condition_view_size = 32;
  options.front_cameras = options.view_geometry = true;
  if (with_features) options.features = "surface";
  options.test_fraction = 0.0;
  options.seed = 9;
  engine::prepare({comparison.dog()}, of_library, options);
  const auto files = test::dataset_files(of_program);
  require(files.size() > 20 && files == test::dataset_files(of_library), "the datasets differ");
}

/// A generated asset in the order of vertices that its file has.
Asset as_written(const Asset& asset) { return engine::load_bytes(engine::save_bytes(asset), asset.name + ".glb"); }

void compare_generations(const Comparison& comparison, const fs::path& weights, const fs::path& image) {
  comparison.run("anigen-generate",
                 {image.string(), "--runs", weights.string(), "--seed", "7", "--ss-steps", "6", "--slat-steps", "5",
                  "--ss-guidance", "3", "--slat-guidance", "2", "--background", "alpha", "--colors", "decoded",
                  "--output", comparison.of_program("made").string()});
  engine::GeneratorOptions models;
  models.runs = weights;
  models.background = "alpha";
  models.image_colors = false;
  engine::GenerateOptions options;
  options.seed = 7;
  options.structure_steps = 6;
  options.latent_steps = 5;
  options.structure_guidance = 3;
  options.latent_guidance = 2;
  const Asset made = as_written(engine::Generator(models).generate(image, options).asset);
  const Asset written = engine::load(comparison.of_program("made") / image.stem() / "mesh.glb");
  require(made.mesh.vertices == written.mesh.vertices && made.mesh.faces == written.mesh.faces,
          "the generated meshes differ");
  // The program's file has four joints per vertex.
  require(made.skeleton.names == written.skeleton.names && made.skeleton.parents == written.skeleton.parents,
          "the generated skeletons differ");
  const std::vector<Eigen::Vector3d> joints = made.skeleton.positions(), in_file = written.skeleton.positions();
  for (std::size_t j = 0; j < joints.size(); ++j)
    require((joints[j] - in_file[j]).norm() < 1e-6, "the generated joints differ");
}

}  // namespace

int main(int argc, char** argv) {
  try {
    require(argc == 2 || argc == 4, "usage: library_and_programs FOLDER_OF_PROGRAMS [WEIGHTS IMAGE]");
    const Comparison comparison(argv[1]);
    compare_rigs(comparison);
    compare_clips(comparison);
    compare_all_scores(comparison);
    compare_datasets(comparison, argc == 4);
    if (argc == 4) compare_generations(comparison, argv[2], argv[3]);
    std::printf("programs and library agree\n");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "library_and_programs: %s\n", error.what());
    return 1;
  }
}
