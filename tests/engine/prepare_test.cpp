#include "anigen/engine/prepare.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "anigen/engine/files.h"
#include "anigen/prepare/dataset.h"
#include "tests/support/dataset_files.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;

class EnginePrepare : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(rigs());
    save(test::hinged_boxes(0.1F, 0.2F), rigs() / "boxes.glb");
    std::ofstream(rigs() / "broken.glb") << "glTF";
    options_.creatures = 3;
    options_.resolution = 16;
    options_.condition_views = 1;
    options_.condition_view_size = 32;
  }

  fs::path rigs() const { return folder_.path() / "rigs"; }

  test::TemporaryFolder folder_;
  PrepareOptions options_;
};

TEST_F(EnginePrepare, MakesTheDatasetOfTheProgram) {
  std::map<std::string, double> heard;
  Job job([&](const std::string& stage, double fraction) { heard[stage] = fraction; });
  const fs::path out = folder_.path() / "data";
  const PreparedDataset made = prepare({rigs()}, out, options_, &job);
  EXPECT_EQ(made.assets, 4U);
  EXPECT_EQ(made.train + made.test + made.unusable, 4U);
  EXPECT_EQ(made.reused, 0U);
  EXPECT_EQ(made.failed_steps, 1U);
  ASSERT_EQ(made.rejected.size(), 1U);
  EXPECT_NE(made.rejected[0].source.find("broken.glb"), std::string::npos);
  EXPECT_EQ(made.rejected[0].step, "import");
  EXPECT_EQ(heard["prepare"], 1.0);
  EXPECT_TRUE(fs::is_regular_file(out / "metadata.csv"));
  const auto files = test::dataset_files(out);
  EXPECT_EQ(std::count_if(files.begin(), files.end(),
                          [](const auto& file) { return file.first.rfind("renders_cond/", 0) == 0; }),
            8)
      << "a picture and its camera each";

  anigen::prepare::PrepareOptions program;
  program.out = folder_.path() / "program";
  program.sources = anigen::prepare::find_assets({rigs()});
  for (const auto& creature : anigen::prepare::procedural_sources(0, 3)) program.sources.push_back(creature);
  program.plan.resolution = 16;
  program.plan.condition_views.count = 1;
  program.plan.condition_views.size = 32;
  anigen::prepare::prepare_dataset(program);
  EXPECT_EQ(files, test::dataset_files(program.out));
  EXPECT_EQ(prepare({rigs()}, out, options_).reused, 4U);
}

TEST_F(EnginePrepare, GoesOnWhereItWasCancelled) {
  const fs::path out = folder_.path() / "data", whole = folder_.path() / "whole";
  options_.creatures = 8;
  Job cancelled([&](const std::string& stage, double fraction) {
    if (stage == "prepare" && fraction > 0.0) throw std::runtime_error("no longer wanted");
  });
  EXPECT_THROW(prepare({}, out, options_, &cancelled), Interrupted);
  EXPECT_FALSE(fs::exists(out / "metadata.csv"));
  EXPECT_EQ(prepare({}, out, options_).assets, 8U);
  prepare({}, whole, options_);
  EXPECT_EQ(test::dataset_files(out), test::dataset_files(whole));
}

TEST_F(EnginePrepare, RefusesWhatCannotBePrepared) {
  const fs::path out = folder_.path() / "data";
  const auto refused = [&](const std::vector<fs::path>& inputs, const PrepareOptions& options, const char* words) {
    try {
      prepare(inputs, out, options);
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find("--"), std::string::npos)
          << "an option of the program: " << error.what();
    }
  };
  refused({}, {}, "nothing to prepare");
  refused({folder_.path() / "missing"}, {}, "missing");
  EXPECT_THROW(prepare({rigs()}, folder_.path(), options_), InputError) << "would write where it reads";
  PrepareOptions options = options_;
  options.cleaning = "soap";
  refused({rigs()}, options, "cleaning: \"soap\"");
  options = options_;
  options.resolution = 1;
  refused({rigs()}, options, "resolution: must lie in 2 … 1024");
  options = options_;
  options.poses = 10'001;
  refused({rigs()}, options, "poses: at most 10000");
  options = options_;
  options.views = 1001;
  refused({rigs()}, options, "views: at most 1000");
  options = options_;
  options.view_size = 4;
  refused({rigs()}, options, "view_size: must lie in 8");
  options = options_;
  options.condition_view_size = 4097;
  refused({rigs()}, options, "condition_view_size: must lie in 8");
  options = options_;
  options.features = "surface";
  options.resolution = 512;
  refused({rigs()}, options, "at most 256 with features");
  options = options_;
  options.test_fraction = 1.5;
  refused({rigs()}, options, "test_fraction: must lie in [0, 1], got 1.5");
}

TEST(EnginePrepareAsset, GivesATrainingExample) {
  Asset dog = creatures::make_creature("quadruped", 3, 0);
  const std::size_t joints = dog.skeleton.size();
  PrepareOptions options;
  options.resolution = 32;
  const PreparedAsset prepared = prepare(dog, options);
  const Box box = bounding_box(prepared.asset.mesh.vertices);
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-5);
  const Eigen::Vector3d moved = prepared.scale * dog.mesh.vertices[5].cast<double>() + prepared.offset;
  EXPECT_LT((moved - prepared.asset.mesh.vertices[5].cast<double>()).norm(), 1e-5);
  EXPECT_GT(prepared.voxels.size(), prepared.skeleton_voxels.size());
  EXPECT_TRUE(std::is_sorted(prepared.voxels.begin(), prepared.voxels.end()));
  for (const VoxelIndex& voxel : prepared.voxels)
    for (const std::int32_t place : voxel) EXPECT_TRUE(place >= 0 && place < 32);
  EXPECT_EQ(prepared.asset.skeleton.size(), joints);
  EXPECT_TRUE(prepared.findings.empty());
  EXPECT_TRUE(prepared.usable);

  dog.skin = {};
  EXPECT_THROW(prepare(dog), InputError);
  EXPECT_THROW(prepare(Asset()), InputError);
  options.resolution = 0;
  EXPECT_THROW(prepare(test::hinged_boxes(0.1F, 0.2F), options), InputError);
  options = {};
  options.cleaning = "anymate";  // which wants more bones
  try {
    prepare(test::hinged_boxes(0.1F, 0.2F), options);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("hinge"), std::string::npos) << error.what();
  }
  Job cancelled;
  cancelled.cancel();
  EXPECT_THROW(prepare(test::hinged_boxes(0.1F, 0.2F), {}, &cancelled), Interrupted);
}

}  // namespace

}  // namespace anigen::engine
