#include <gtest/gtest.h>
#include <fstream>
#include <functional>
#include <map>
#include <new>
#include <set>
#include <stdexcept>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/steps.h"
#include "anigen/render/cameras_json.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

/// Two channels: the voxel's x, and how many pictures there are.
class FakeExtractor : public FeatureExtractor {
 public:
  std::string name() const override { return "fake"; }
  std::string fingerprint() const override { return given_fingerprint; }
  int channels() const override { return 2; }
  bool needs_views() const override { return given_needs_views; }
  io::NdArray extract(const FeatureRequest& request) const override {
    ++calls;
    if (problem) problem();
    if (given_needs_views) render::read_transforms(request.views / "transforms.json");
    io::NdArray array;
    array.dtype = io::Dtype::kF16;
    array.shape = {static_cast<std::int64_t>(request.voxels.size()), 2};
    array.bytes.assign(request.voxels.size() * 4, 0);
    return array;
  }

  std::string given_fingerprint = "one";
  bool given_needs_views = true;
  std::function<void()> problem;
  mutable int calls = 0;
};

class Steps : public testing::Test {
 protected:
  Steps() {
    plan_.views.count = 2;
    plan_.views.size = 24;
    plan_.condition_views.count = 3;
    plan_.condition_views.size = 16;
    plan_.features.model = "fake";
    plan_.variants = 1;
    plan_.keep_assets = false;
  }

  SourceOutcome prepare(std::vector<StepFailure> known = {}) {
    began_.clear();
    const SourcePreparer preparer(folder_ / "out", plan_, extractor_);
    SourceTask task;
    task.source = procedural_sources(5, 1)[0];
    task.known = std::move(known);
    return preparer.prepare(task, [&](const StepBegin& at) { began_.push_back(at); });
  }

  /// Steps of the asset itself that were done, in order.
  std::vector<std::string> steps(std::size_t variant = 0) const {
    std::vector<std::string> names;
    for (const StepBegin& at : began_) {
      if (at.variant == variant) names.push_back(at.step);
    }
    return names;
  }

  using Names = std::vector<std::string>;
  test::TemporaryFolder folder_;
  StepPlan plan_;
  std::shared_ptr<FakeExtractor> extractor_ = std::make_shared<FakeExtractor>();
  std::vector<StepBegin> began_;
};

TEST_F(Steps, MakeEveryFileOfThePublishedLayout) {
  const SourceOutcome outcome = prepare();
  ASSERT_EQ(outcome.assets.size(), 2u);
  EXPECT_EQ(steps(), (Names{"import", "skeleton", "voxels", "views", "cond_views", "features/fake"}));
  EXPECT_EQ(steps(1), (Names{"augment", "skeleton", "voxels", "views", "cond_views", "features/fake"}));
  EXPECT_NE(outcome.assets[0].id, outcome.assets[1].id);
  for (const AssetOutcome& asset : outcome.assets) {
    EXPECT_TRUE(asset.imported);
    EXPECT_FALSE(asset.reused);
    EXPECT_TRUE(asset.failures.empty());
    EXPECT_EQ(asset.timings.size(), 6u);
    const AssetPlaces places{folder_ / "out", asset.id};
    EXPECT_TRUE(fs::exists(places.views() / "mesh.ply"));
    EXPECT_EQ(render::read_transforms(places.views() / "transforms.json").frames.size(), 2u);
    EXPECT_EQ(io::read_image(places.views() / "001.png").width, 24);
    EXPECT_EQ(render::read_transforms(places.condition_views() / "transforms.json").frames.size(), 3u);
    EXPECT_EQ(io::read_image(places.condition_views() / "002.png").width, 16);
    const auto voxels = read_voxel_rows(places.surface_voxels(), 64);
    const io::NamedArrays features = io::read_npz(places.features("fake"));
    EXPECT_EQ(io::find(features, "indices")->dtype, io::Dtype::kU8);
    EXPECT_EQ(io::find(features, "patchtokens")->dtype, io::Dtype::kF16);
    const auto indices = io::find(features, "indices")->as<std::int32_t>();
    ASSERT_EQ(indices.size(), 3 * voxels.size());
    for (std::size_t i = 0; i < indices.size(); ++i) ASSERT_EQ(indices[i], voxels[i / 3][i % 3]);
    const StepRecords records = read_step_records(places.record());
    EXPECT_EQ(records.columns("voxels").at("num_voxels").get<std::size_t>(), voxels.size());
    EXPECT_EQ(records.steps.at("views").files, 4u);
  }
  EXPECT_EQ(read_step_records(AssetPlaces{folder_ / "out", outcome.assets[1].id}.record())
                .columns(kImport)
                .at("pose")
                .at("source"),
            outcome.assets[0].id);
}

TEST_F(Steps, AreNotDoneTwice) {
  prepare();
  const SourceOutcome again = prepare();
  EXPECT_TRUE(began_.empty());
  EXPECT_TRUE(again.assets[0].reused);
  EXPECT_TRUE(again.assets[1].reused);
  EXPECT_EQ(extractor_->calls, 2);
}

TEST_F(Steps, AreDoneAgainWhenTheirOptionsOrInputsChange) {
  prepare();
  extractor_->given_fingerprint = "other weights";
  prepare();
  EXPECT_EQ(steps(), (Names{"features/fake"}));
  plan_.views.count = 1;
  const SourceOutcome fewer = prepare();
  EXPECT_EQ(steps(), (Names{"views", "features/fake"}));
  EXPECT_FALSE(fs::exists(AssetPlaces{folder_ / "out", fewer.assets[0].id}.views() / "001.png"));
  plan_.resolution = 32;
  prepare();
  EXPECT_EQ(steps(), (Names{"voxels", "features/fake"}));
  plan_.cleaning.joints.least = 2;
  prepare();
  EXPECT_EQ(steps().size(), 6u);
  EXPECT_EQ(steps(1).size(), 6u) << "a posed variant is made from the cleaned asset, too";
}

TEST_F(Steps, AreDoneAgainWhenAFileIsGoneOrCutOff) {
  const SourceOutcome outcome = prepare();
  const AssetPlaces places{folder_ / "out", outcome.assets[0].id};
  fs::remove(places.views() / "000.png");
  prepare();
  EXPECT_EQ(steps(), (Names{"views", "features/fake"}));
  fs::resize_file(places.skeleton(), 100);
  prepare();
  EXPECT_EQ(steps(), (Names{"skeleton"}));
  write_file_atomically(places.record(), "{\"format\": 2, \"steps\": {\"import\": 3}}");
  prepare();
  EXPECT_EQ(steps().size(), 6u);
  EXPECT_TRUE(steps(1).empty());
}

TEST_F(Steps, TakeInputsAsTheyAreWhenOnlyADependentStepIsAsked) {
  prepare();
  plan_.steps = {"features"};
  plan_.views.count = 0;  // a later call need not repeat how the views were made
  extractor_->given_fingerprint = "two";
  prepare();
  EXPECT_EQ(steps(), (Names{"features/fake"}));
}

TEST_F(Steps, WithoutTheirInputsAreMadeWithThem) {
  plan_.steps = {"features"};
  prepare();
  EXPECT_EQ(steps(), (Names{"import", "voxels", "views", "features/fake"}));
}

TEST_F(Steps, OfAnotherModelStayWhileTheirInputsDo) {
  const SourceOutcome outcome = prepare();
  const fs::path record = AssetPlaces{folder_ / "out", outcome.assets[0].id}.record();
  plan_.features.model.clear();
  extractor_.reset();
  prepare();
  EXPECT_TRUE(read_step_records(record).has("features/fake"));
  plan_.resolution = 16;
  prepare();
  EXPECT_FALSE(read_step_records(record).has("features/fake"));
}

TEST_F(Steps, ThatFailedBeforeAreSkippedAndOthersGoOn) {
  const SourceOutcome outcome = prepare();
  fs::remove_all(folder_ / "out");
  StepFailure known;
  for (const StepBegin& at : began_) {
    if (at.variant == 0 && at.step == "voxels") known = {at.id, 0, at.step, at.fingerprint, "took too long", ""};
  }
  const SourceOutcome second = prepare({known});
  EXPECT_EQ(steps(), (Names{"import", "skeleton", "views", "cond_views"}));
  EXPECT_EQ(steps(1).size(), 6u);
  ASSERT_EQ(second.assets[0].failures.size(), 1u);
  EXPECT_EQ(second.assets[0].failures[0].reason, "took too long");
  plan_.resolution = 32;  // not the same any more
  EXPECT_TRUE(prepare({known}).assets[0].failures.empty());
}

// Whatever a step throws fails the step of that asset, and the worker lives on for the next one.
TEST_F(Steps, FailWithWhateverTheyThrow) {
  const auto failure = [&](std::function<void()> problem) {
    fs::remove_all(folder_ / "out");
    extractor_->problem = std::move(problem);
    const SourceOutcome outcome = prepare();
    EXPECT_EQ(steps(), (Names{"import", "skeleton", "voxels", "views", "cond_views", "features/fake"}));
    return outcome.assets.at(0).failures.size() == 1 ? outcome.assets[0].failures[0].reason : "";
  };
  EXPECT_NE(failure([] { throw std::bad_alloc(); }).find("out of memory"), std::string::npos);
  EXPECT_NE(failure([] { throw std::runtime_error("a\nException raised from b"); }).find(": a"), std::string::npos);
  EXPECT_NE(failure([] { throw Error("Embree cannot start"); }).find("Embree"), std::string::npos);
  EXPECT_NE(failure([] { throw InputError("x.pth", "", "is cut off"); }).find("x.pth"), std::string::npos);
  extractor_->problem = [] { throw Interrupted("stopped"); };
  fs::remove_all(folder_ / "out");
  EXPECT_THROW(prepare(), Interrupted);
  extractor_->problem = [] { throw WriteError("disk full"); };
  EXPECT_THROW(prepare(), WriteError) << "no fault of the asset";
}

TEST_F(Steps, GiveEqualBytesHoweverTheyWereInterrupted) {
  const auto contents = [&] {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / "out")) {
      if (entry.is_regular_file()) files[entry.path().string()] = read_file(entry.path());
    }
    return files;
  };
  prepare();
  const auto whole = contents();
  fs::remove_all(folder_ / "out");
  // As if killed at the beginning of the n-th step: of the asset, at the border, of its variant.
  for (const std::size_t n : {1, 3, 5, 6, 8, 11}) {
    fs::remove_all(folder_ / "out");
    std::size_t begun = 0;
    const SourcePreparer preparer(folder_ / "out", plan_, extractor_);
    SourceTask task;
    task.source = procedural_sources(5, 1)[0];
    EXPECT_THROW(preparer.prepare(task,
                                  [&](const StepBegin&) {
                                    if (begun++ == n) throw Error("killed");
                                  }),
                 Error);
    prepare();
    EXPECT_EQ(contents(), whole) << "interrupted at step " << n;
  }
}

TEST(PrepareSource, AFileThatGoesAwayMeanwhileIsTriedAgain) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "in/hinge.glb", hidden = folder / "hidden";
  io::write_gltf(file, test::hinged_boxes(0.1F, 0.3F));
  StepPlan plan;
  plan.steps = {"skeleton"};
  const SourcePreparer preparer(folder / "out", plan, nullptr);
  const StepObserver nobody = [](const StepBegin&) {};
  SourceTask task;
  task.source = find_assets({file}).at(0);
  task.id = asset_id(task.source);
  fs::rename(file, hidden);
  task.known = preparer.prepare(task, nobody).assets.at(0).failures;
  ASSERT_EQ(task.known.size(), 1U);
  EXPECT_EQ(task.known[0].fingerprint, "") << task.known[0].reason;
  fs::rename(hidden, file);
  const SourceOutcome outcome = preparer.prepare(task, nobody);
  EXPECT_TRUE(outcome.assets.at(0).imported);
  EXPECT_TRUE(outcome.assets.at(0).failures.empty());
}

TEST(PrepareSource, AFileThatIsWrongStaysWrong) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "in/wrong.glb";
  write_file_atomically(file, "glTF, or so it says");
  const SourcePreparer preparer(folder / "out", StepPlan{}, nullptr);
  std::size_t tries = 0;
  const StepObserver counting = [&](const StepBegin&) { ++tries; };
  SourceTask task;
  task.source = find_assets({file}).at(0);
  for (int run = 0; run < 2; ++run) {
    task.known = preparer.prepare(task, counting).assets.at(0).failures;
    ASSERT_EQ(task.known.size(), 1U);
    EXPECT_NE(task.known[0].fingerprint, "");
  }
  EXPECT_EQ(tries, 1U);
}

TEST(StepPlans, RefuseWhatCannotBe) {
  StepPlan plan;
  plan.steps = {"voxel"};
  EXPECT_THROW(plan.validate(), InputError);
  plan.steps = {"features"};
  EXPECT_THROW(plan.validate(), InputError);
  plan.steps = {"augment"};
  EXPECT_THROW(plan.validate(), InputError);
  plan.steps.clear();
  plan.resolution = 1;
  EXPECT_THROW(plan.validate(), InputError);
  plan.resolution = 64;
  plan.views.size = 0;
  EXPECT_THROW(plan.validate(), InputError);
  plan.views.size = 64;
  EXPECT_NO_THROW(plan.validate());
}

TEST(StepPlans, SurviveTheWayToAWorker) {
  StepPlan plan;
  plan.steps = {"import", "views"};
  plan.keep_assets = false;
  plan.resolution = 32;
  plan.views = {24, 128, 3, true, 0};
  plan.features = {"dinov2_vits14_reg", "w.pth", "cuda:1"};
  plan.variants = 4;
  plan.poses.max_angle = 30;
  plan.poses.own_motion = false;
  plan.cleaning = cleaning_preset("anymate");
  plan.seed = 9;
  const Json json = plan;
  EXPECT_EQ(Json(json.get<StepPlan>()), json);
  EXPECT_EQ(json.get<StepPlan>().features.device, "cuda:1");
  EXPECT_EQ(json.get<StepPlan>().poses.max_angle, 30);
}

TEST(Outcomes, SurviveTheWayFromAWorker) {
  SourceOutcome outcome;
  outcome.number = 7;
  AssetOutcome asset;
  asset.id = "abc";
  asset.variant = 2;
  asset.imported = true;
  asset.rejected_pose = true;
  asset.failures = {{"abc", 2, "views", "f", "a \"reason\"\nwith lines", "rule"}};
  asset.timings = {{"voxels", 0.25, std::uint64_t{1} << 33}};
  outcome.assets = {asset};
  const Json json = outcome;
  EXPECT_EQ(Json(json.get<SourceOutcome>()), json);
  SourceTask task;
  task.source = procedural_sources(3, 2)[1];
  task.known = asset.failures;
  task.only_identify = true;
  EXPECT_EQ(Json(Json(task).get<SourceTask>()), Json(task));
}

}  // namespace

namespace {

using geometry::Voxel;

TEST(VoxelFile, RoundTripInPublishedForm) {
  const test::TemporaryFolder folder;
  const auto path = folder / "voxels/a.ply";
  const std::vector<Voxel> voxels = {{0, 0, 0}, {0, 63, 2}, {31, 32, 33}, {63, 63, 63}};
  write_voxel_ply(path, voxels, 64);
  EXPECT_EQ(read_voxel_ply(path, 64), voxels);
  const std::string bytes = read_file(path);
  EXPECT_EQ(bytes.substr(0, 37), "ply\nformat binary_little_endian 1.0\nc");
  const std::size_t end = bytes.find("end_header\n") + 11;
  EXPECT_NE(bytes.find("element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
            std::string::npos);
  ASSERT_EQ(bytes.size(), end + 4 * 12);
  // The first centre is -0.5 + 0.5/64 = -0.4921875, exactly 0xBEFC0000.
  EXPECT_EQ(bytes.substr(end, 4), std::string("\x00\x00\xFC\xBE", 4));
}

TEST(VoxelFile, EqualSetsGiveEqualBytes) {
  const test::TemporaryFolder folder;
  write_voxel_ply(folder / "a.ply", {{1, 2, 3}, {0, 5, 0}, {0, 0, 9}}, 10);
  write_voxel_ply(folder / "b.ply", {{0, 0, 9}, {1, 2, 3}, {0, 5, 0}, {0, 0, 9}}, 10);
  EXPECT_EQ(read_file(folder / "a.ply"), read_file(folder / "b.ply"));
}

TEST(VoxelFile, RowsKeepTheFilesOrderAndRepetitions) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "a.ply",
                        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
                        "property double z\nend_header\n0.3 0.3 0.3\n-0.5 -0.5 -0.5\n0.3 0.3 0.3\n");
  EXPECT_EQ(read_voxel_rows(folder / "a.ply", 10), (std::vector<Voxel>{{8, 8, 8}, {0, 0, 0}, {8, 8, 8}}));
  EXPECT_EQ(read_voxel_ply(folder / "a.ply", 10), (std::vector<Voxel>{{0, 0, 0}, {8, 8, 8}}));
}

TEST(VoxelFile, RefusesBadInput) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {}, 64), InputError);
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {{0, 0, 64}}, 64), InputError);
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {{0, 0, 0}}, 0), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.ply"));
  EXPECT_THROW(read_voxel_ply(folder / "missing.ply", 64), InputError);
  write_voxel_ply(folder / "b.ply", {{0, 0, 0}, {1, 1, 1}}, 64);
  const std::string bytes = read_file(folder / "b.ply");
  write_file_atomically(folder / "c.ply", bytes.substr(0, bytes.size() - 1));
  EXPECT_THROW(read_voxel_ply(folder / "c.ply", 64), InputError);
  write_file_atomically(folder / "d.ply",
                        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                        "property float z\nend_header\n0 0 0\n0 0 0.5\n");
  try {
    read_voxel_ply(folder / "d.ply", 64);
    FAIL() << "a point outside the cube was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), (folder / "d.ply").string());
    EXPECT_EQ(error.place(), "vertex 1");
  }
}

}  // namespace

}  // namespace anigen::prepare
