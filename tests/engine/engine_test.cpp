#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "anigen/anigen.h"
#include "anigen/core/files.h"
#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;
using creatures::make_creature;

/// A dog's surface without its rig.
Asset dog_mesh() {
  Asset dog = make_creature("quadruped", 3, 0);
  dog.skeleton = {};
  dog.skin = {};
  dog.animations.clear();
  dog.name = "dog";
  return dog;
}

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

std::string bytes_of(const fs::path& file) { return read_file(file); }

class EngineFiles : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(EngineFiles, AreTheSameInMemory) {
  const Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  for (const std::string format : {"glb", "gltf", "fbx", "usdz"}) {
    const fs::path file = folder_.path() / (boxes.name + "." + format);
    save(boxes, file);
    EXPECT_EQ(save_bytes(boxes, format).size(), bytes_of(file).size()) << format;
    if (format == "usdz") continue;
    const Asset from_file = load(file), from_memory = load_bytes(bytes_of(file), "hinge." + format);
    EXPECT_EQ(from_memory.mesh.vertices, from_file.mesh.vertices) << format;
    EXPECT_EQ(from_memory.skeleton.names, boxes.skeleton.names) << format;
    EXPECT_EQ(from_memory.skin.offsets, from_file.skin.offsets) << format;
  }
}

TEST_F(EngineFiles, AreMeshesToo) {
  const std::string text = test::obj_text(test::RigFile());
  const Asset mesh = load_bytes(text, "quads.obj");
  EXPECT_EQ(mesh.mesh.vertices.size(), static_cast<std::size_t>(test::RigFile().vertex_count()));
  EXPECT_EQ(mesh.skeleton.size(), 0U);
  save(mesh, folder_.path() / "quads.glb");
  EXPECT_EQ(load(folder_.path() / "quads.glb").mesh.faces.size(), mesh.mesh.faces.size());
}

TEST_F(EngineFiles, AreRefusedWithTheirNameAndPlace) {
  const std::string glb = save_bytes(test::hinged_boxes(0.1F, 0.2F));
  EXPECT_NE(error_of([&] { load_bytes(glb.substr(0, 200), "cut.glb"); }).find("cut.glb"), std::string::npos);
  EXPECT_NE(error_of([&] { load_bytes("", "none.glb"); }).find("empty"), std::string::npos);
  EXPECT_NE(error_of([&] { load_bytes("v 0 0 nan\n", "bad.obj"); }).find("bad.obj"), std::string::npos);
  EXPECT_NE(error_of([&] { load_bytes(glb, "noextension"); }).find("extension"), std::string::npos);
  EXPECT_NE(error_of([&] { load(folder_.path() / "missing.glb"); }).find("missing.glb"), std::string::npos);
  const std::string outside = R"({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4, "uri": "secret.bin"}]})";
  EXPECT_NE(error_of([&] { load_bytes(outside, "a.gltf"); }).find("cannot refer to \"secret.bin\""), std::string::npos);
}

TEST_F(EngineFiles, RigAsTheProgramDoes) {
  const fs::path mesh = folder_.path() / "dog.glb";
  save(dog_mesh(), mesh);
  RigOptions options;
  options.method = "curve";
  options.joints = 14;
  const std::string note = rig_file(mesh, folder_.path() / "rigged.glb", options);
  const Rigged rigged = rig(load(mesh), options);
  EXPECT_EQ(rigged.note, note);
  EXPECT_EQ(rigged.asset.skeleton.size(), 14U);
  const Asset from_file = load(folder_.path() / "rigged.glb");
  ASSERT_EQ(from_file.skeleton.names, rigged.asset.skeleton.names);
  const auto places = rigged.asset.skeleton.positions(), in_file = from_file.skeleton.positions();
  for (std::size_t j = 0; j < places.size(); ++j) EXPECT_LT((places[j] - in_file[j]).norm(), 1e-5);
  EXPECT_NE(error_of([&] { rig_file(mesh, mesh, options); }), "");
  EXPECT_NE(error_of([&] { rig_file(folder_.path(), folder_.path() / "all", options); }).find("is a folder"),
            std::string::npos);
  options.joints = 100'000;
  EXPECT_EQ(error_of([&] { rig(load(mesh), options); }).rfind("joints: ", 0), 0U);
}

TEST(EngineRig, KeepsTheSkeletonAndClipsThatAMeshHas) {
  Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  Animation clip;
  clip.name = "open";
  boxes.animations.push_back(clip);
  const Rigged rigged = rig(boxes);
  EXPECT_EQ(rigged.asset.skeleton.names, boxes.skeleton.names);
  ASSERT_EQ(rigged.asset.animations.size(), 1U);
  EXPECT_EQ(rigged.asset.animations.front().name, "open");
  EXPECT_NE(rigged.note.find("keeps its own joints"), std::string::npos);
}

TEST(EngineRig, KeepsClipsUnderNewNamesAndSaysWhereItCannot) {
  Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  boxes.animations = {
      {"open", {{1, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.5}, {0, 0, 0, 1, 0, 0.6, 0, 0.8}}}}};
  RigOptions options;
  options.names = "chain";
  const Rigged named = rig(boxes, options);
  ASSERT_EQ(named.asset.animations.size(), 1U);
  EXPECT_EQ(named.asset.skeleton.names[0].rfind("chain_", 0), 0U) << named.asset.skeleton.names[0];
  options.height = 2.0;
  const Rigged scaled = rig(boxes, options);
  EXPECT_TRUE(scaled.asset.animations.empty());
  EXPECT_NE(scaled.note.find("1 clip left out"), std::string::npos) << scaled.note;
}

TEST(EngineRig, FitsEnginesAndRefusesUnknownWords) {
  RigOptions options;
  options.method = "curve";
  options.height = 1.8;
  options.ground = true;
  options.root_bone = true;
  const Rigged rigged = rig(dog_mesh(), options);
  const Box box = bounding_box(rigged.asset.mesh.vertices);
  EXPECT_NEAR(box.low.z(), 0.0, 1e-5);
  EXPECT_NEAR(box.high.z(), 1.8, 1e-5);
  EXPECT_TRUE(validate(rigged.asset).empty());
  options.method = "magic";
  EXPECT_EQ(error_of([&] { rig(dog_mesh(), options); }).rfind("method: \"magic\" is none of", 0), 0U);
  Asset nothing;
  EXPECT_NE(error_of([&] { rig(nothing); }).find("no surface"), std::string::npos);
}

TEST_F(EngineFiles, AreRefusedByTheNamesOfTheLibrarysOptions) {
  const fs::path mesh = folder_.path() / "dog.glb", rigged = folder_.path() / "rigged.glb";
  save(dog_mesh(), mesh);
  const auto refused = [&](const std::string& words, const RigOptions& options, const fs::path& to) {
    const std::string by_file = error_of([&] { rig_file(mesh, to, options); });
    EXPECT_NE(by_file.find(words), std::string::npos) << by_file;
    EXPECT_EQ(by_file.find("--"), std::string::npos) << "an option of the program: " << by_file;
  };
  RigOptions options;
  options.skin = "closest";
  refused("skin: \"closest\" is none of", options, rigged);
  options = {};
  options.bone_axes = "bent";
  refused("bone_axes: \"bent\" is none of", options, rigged);
  options = {};
  options.names = "xsi";
  refused("names: \"xsi\" is none of", options, rigged);
  options = {};
  options.templates = {"cow"};
  refused("templates: \"cow\" is none of", options, rigged);
  options = {};
  options.method = "curve";
  refused("to: rigs are written as", options, folder_.path() / "rigged.obj");
  options.add_joints = true;
  refused("add_joints: holds no skeleton", options, rigged);
  options = {};
  options.method = "nearest";
  options.names = "vrm";
  const Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  EXPECT_NE(error_of([&] { rig(boxes, options); }).find("names of an engine"), std::string::npos);

  EvaluateOptions scores;
  scores.protocol = "ours";
  EXPECT_EQ(error_of([&] { evaluate(boxes, boxes, scores); }).rfind("protocol: \"ours\" is none of", 0), 0U);
  scores.protocol = "skintokens";
  EXPECT_EQ(error_of([&] { evaluate(boxes, boxes, scores); }).rfind("protocol: not supported: skintokens", 0), 0U);
  EXPECT_EQ(error_of([&] { animate(boxes, {{"moonwalk"}}); }).rfind("motions: 'moonwalk' is neither", 0), 0U);
}

TEST(EngineJobs, AreWatchedAndCancelledOneByOne) {
  std::set<std::string> stages;
  Job watched([&](const std::string& stage, double fraction) {
    stages.insert(stage);
    EXPECT_GE(fraction, 0.0);
    EXPECT_LE(fraction, 1.0);
  });
  Job cancelled;
  cancelled.cancel();
  RigOptions options;
  options.method = "curve";
  std::thread other([&] { EXPECT_THROW(rig(dog_mesh(), options, &cancelled), Interrupted); });
  EXPECT_GT(rig(dog_mesh(), options, &watched).asset.skeleton.size(), 3U);
  other.join();
  EXPECT_EQ(stages.count("rigging"), 1U);
  EXPECT_THROW(evaluate(dog_mesh(), dog_mesh(), {}, &cancelled), Interrupted);
}

TEST(EngineAnimation, MovesWhatABodyCanMove) {
  const Asset dog = make_creature("quadruped", 3, 0);
  const std::vector<std::string> words = motions_of(dog);
  ASSERT_NE(std::find(words.begin(), words.end(), "walk"), words.end());
  const std::vector<Animation> clips = animate(dog, {{"walk", "idle"}});
  ASSERT_EQ(clips.size(), 2U);
  EXPECT_GT(clips.front().duration(), 0.2);
  EXPECT_NE(error_of([&] { animate(dog, {{"moonwalk"}}); }).find("moonwalk"), std::string::npos);
  EXPECT_NE(error_of([&] { animate(dog, {{"fly"}}); }), "");
}

TEST(EngineScores, AreThoseOfThePair) {
  const Asset truth = make_creature("quadruped", 3, 0);
  EvaluateOptions options;
  options.groups = {"skeleton", "transport", "skin"};
  options.normalization = "truth";
  options.registration = false;
  const Scores same = evaluate(truth, truth, options);
  EXPECT_NEAR(same.values.at("j2j"), 0.0, 1e-9);
  EXPECT_NEAR(same.values.at("gromov_wasserstein"), 0.0, 1e-6);
  Asset moved = truth;
  for (Eigen::Matrix4d& bind : moved.skeleton.bind)
    bind(0, 3) += 0.05 * bounding_box(truth.mesh.vertices).longest_side();
  const Scores scores = evaluate(moved, truth, options);
  EXPECT_NEAR(scores.values.at("wasserstein"), 0.05, 0.02);
  EXPECT_NEAR(scores.values.at("gromov_wasserstein"), 0.0, 1e-6);
  const JointTree a = joint_tree(moved.skeleton), b = joint_tree(truth.skeleton);
  EXPECT_NEAR(gromov_wasserstein(a, b), 0.0, 1e-6);
  EXPECT_GT(wasserstein(a, b), 0.0);
  EXPECT_GT(chamfer(a, b).j2j, 0.0);
  EXPECT_NEAR(chamfer(b, b).j2b, 0.0, 1e-9);
  options.groups = {"beauty"};
  EXPECT_NE(error_of([&] { evaluate(truth, truth, options); }).find("beauty"), std::string::npos);
}

TEST(EnginePictures, ShowAMomentOfAClip) {
  Asset dog = make_creature("quadruped", 3, 0);
  dog.animations = animate(dog, {{"walk"}});
  RenderOptions options;
  options.width = options.height = 64;
  const Picture still = render(dog, options);
  EXPECT_EQ(still.rgba.size(), 64U * 64U * 4U);
  options.clip = 0;
  options.time = 0.3;
  EXPECT_NE(render(dog, options).rgba, still.rgba);
  EXPECT_EQ(png_bytes(still).substr(1, 3), "PNG");
  options.time = std::nan("");
  EXPECT_EQ(error_of([&] { render(dog, options); }), "time: must be finite");
  options.clip = 1;
  EXPECT_NE(error_of([&] { render(dog, options); }).find("has 1 clips"), std::string::npos);
  options.mode = "smell";
  EXPECT_NE(error_of([&] { render(dog, options); }).find("smell"), std::string::npos);
}

TEST(EngineLint, FindsWhatIsWrong) {
  Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  boxes.skeleton.names[1] = boxes.skeleton.names[0];
  const std::vector<Finding> findings = lint(boxes);
  ASSERT_FALSE(findings.empty());
  EXPECT_TRUE(
      std::any_of(findings.begin(), findings.end(), [](const Finding& f) { return f.code == "repeated-names"; }));
}

TEST(EngineLint, OfAFileSaysWhatWasRepairedToReadIt) {
  const test::TemporaryFolder folder;
  const Asset boxes = test::hinged_boxes(0.1F, 0.2F);
  const fs::path file = folder / "boxes.gltf";
  save(boxes, file);
  std::string text = read_file(file);
  const std::size_t at = text.find("\"lid\"");
  ASSERT_NE(at, std::string::npos);
  write_file_atomically(file, text.replace(at, 5, "\"base\""));
  const auto repeats = [](const std::vector<Finding>& findings) {
    return std::any_of(findings.begin(), findings.end(), [](const Finding& f) { return f.code == "repeated-names"; });
  };
  EXPECT_TRUE(repeats(lint_file(file)));
  EXPECT_FALSE(repeats(lint(load(file)))) << "load() tells them apart";
  EXPECT_NE(error_of([&] { lint_file(folder / "missing.glb"); }).find("missing.glb"), std::string::npos);
}

#ifdef ANIGEN_WITH_TORCH
class EngineGenerator : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(options_.runs) || !fs::exists(image_))
      GTEST_SKIP() << "not supported: without the weights of the repository";
  }

  const fs::path image_ = test::source_dir() / "examples/creatures/deer.png";
  GeneratorOptions options_ = [] {
    GeneratorOptions options;
    options.runs = test::source_dir() / "weights/anigen-small";
    return options;
  }();
};

TEST_F(EngineGenerator, GoesOnFromTheVoxelsOfAnEarlierCall) {
  Generator generator(options_);
  std::map<std::string, std::string> pictures;
  GenerateOptions options;
  options.pictures = [&](const std::string& name, const std::string& png) { pictures[name] = png; };
  const Generated whole = generator.generate(image_, options);
  ASSERT_EQ(pictures.count("mask"), 1U);
  EXPECT_EQ(pictures.count("voxels"), 1U);
  EXPECT_EQ(pictures.count("votes"), 1U);
  EXPECT_EQ(pictures["mask"].substr(1, 3), "PNG");
  EXPECT_EQ(pictures["mask"].substr(16, 8), bytes_of(image_).substr(16, 8)) << "width and height are the image's";

  GenerateOptions stop;
  stop.stop_at = "voxels";
  const Generated stopped = generator.generate(image_, stop);
  EXPECT_TRUE(stopped.asset.mesh.vertices.empty());
  EXPECT_EQ(stopped.seconds.at("decode"), 0.0);
  EXPECT_EQ(stopped.voxels, whole.voxels);
  GenerateOptions on;
  on.voxels = stopped.voxels;
  std::set<std::string> stages;
  Job job([&](const std::string& stage, double) { stages.insert(stage.substr(0, stage.find(" of "))); });
  const Generated same = generator.generate(image_, on, &job);
  EXPECT_EQ(stages.count("sparse structure"), 0U);
  EXPECT_EQ(same.voxels, whole.voxels);
  EXPECT_EQ(save_bytes(same.asset), save_bytes(whole.asset)) << "bit for bit";
  on.seed = 7;
  EXPECT_NE(save_bytes(generator.generate(image_, on).asset), save_bytes(whole.asset));

  // The mask that was shown, given back; then masks that nothing can be done with.
  GenerateOptions masked = stop;
  masked.mask = pictures["mask"];
  const Generated by_mask = generator.generate(image_, masked);
  EXPECT_NE(by_mask.notices.front().find("mask"), std::string::npos);
  masked.mask = png_bytes({8, 8, std::vector<std::uint8_t>(8 * 8 * 4, 255)});
  EXPECT_NE(error_of([&] { generator.generate(image_, masked); }).find("8 x 8"), std::string::npos);
  masked.mask = "no image";
  EXPECT_NE(error_of([&] { generator.generate(image_, masked); }), "");
  on.voxels = stopped.voxels.substr(0, stopped.voxels.size() / 2);
  EXPECT_NE(error_of([&] { generator.generate(image_, on); }).find("voxels"), std::string::npos);
  on.voxels = stopped.voxels;
  on.stop_at = "voxels";
  EXPECT_NE(error_of([&] { generator.generate(image_, on); }).find("nothing to do"), std::string::npos);
  stop.stop_at = "mesh";
  EXPECT_NE(error_of([&] { generator.generate(image_, stop); }).find("no stage"), std::string::npos);
  options.pictures = [](const std::string&, const std::string&) { throw std::runtime_error("not shown"); };
  EXPECT_THROW(generator.generate(image_, options), std::runtime_error);
}

TEST_F(EngineGenerator, TakesBothFlowsFromOnePlace) {
  GeneratorOptions options;
  options.structure_flow = options_.runs / "ss_flow";
  EXPECT_EQ(error_of([&] { Generator generator(options); }),
            "latent_flow: name the runs of both flows, or the folder of both with runs");
  options = {};
  options.runs = options_.runs / "ss_dae";
  const std::string none = error_of([&] { Generator generator(options); });
  EXPECT_NE(none.find("with runs, or runs with structure_flow and latent_flow"), std::string::npos) << none;
}

TEST_F(EngineGenerator, GivesTheAssetOfAnImageInMemory) {
  const fs::path& image = image_;
  const int threads = thread_count();
  set_thread_count(1);
  Generator generator(options_);
  EXPECT_EQ(thread_count(), 1) << "what a program was told stays";
  set_thread_count(threads);
  std::set<std::string> stages;
  Job job([&](const std::string& stage, double) { stages.insert(stage.substr(0, stage.find(" of "))); });
  const Generated made = generator.generate_bytes(bytes_of(image), {}, &job);
  EXPECT_TRUE(validate(made.asset).empty());
  EXPECT_GT(made.asset.skeleton.size(), 3U);
  EXPECT_EQ(stages.count("sparse structure"), 1U);
  EXPECT_EQ(stages.count("structured latents"), 1U);
  const Generated again = generator.generate(image);
  EXPECT_EQ(again.asset.mesh.vertices, made.asset.mesh.vertices);
  EXPECT_EQ(again.asset.skeleton.names, made.asset.skeleton.names);
  Job cancelled([&](const std::string& stage, double fraction) {
    if (stage.rfind("sparse structure", 0) == 0 && fraction > 0.0) throw std::runtime_error("no longer wanted");
  });
  EXPECT_THROW(generator.generate(image, {}, &cancelled), Interrupted);
  EXPECT_NE(error_of([&] { generator.generate_bytes("not an image"); }), "");
}
#endif

}  // namespace

}  // namespace anigen::engine
