#include "anigen/pipeline/flow_runs.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

class FindFlowRuns : public testing::Test {
 protected:
  void add(const std::string& run, const std::string& model, bool counts_joints = false) {
    fs::create_directories(folder_ / run / "ckpts");
    write_file_atomically(folder_ / run / "config.json", R"({"models": {"denoiser": {"name": ")" + model +
                                                             R"(", "args": {"use_joint_num_cond": )" +
                                                             (counts_joints ? "true" : "false") + "}}}}");
  }
  void add_released(const std::string& root) {
    for (const char* name : {"ss_flow_duet", "ss_flow_epic", "ss_flow_solo"}) {
      add(root + "/" + name, "AniGenSparseStructureFlowModel");
    }
    add(root + "/slat_flow_auto", "AniGenElasticSLatFlowModel");
    add(root + "/slat_flow_control", "AniGenElasticSLatFlowModel", true);
    add(root + "/slat_dae", "AniGenElasticSLatEncoder");
  }
  test::TemporaryFolder folder_;
};

TEST_F(FindFlowRuns, TakesTheReleasedDefaults) {
  add_released("ckpts/anigen");
  for (const char* from : {".", "ckpts", "ckpts/anigen"}) {
    const FlowRuns runs = find_flow_runs(folder_ / from, false);
    EXPECT_EQ(runs.structure.filename(), "ss_flow_solo") << from;
    EXPECT_EQ(runs.latents.filename(), "slat_flow_auto") << from;
    EXPECT_EQ(find_flow_runs(folder_ / from, true).latents.filename(), "slat_flow_control") << from;
  }
}

TEST_F(FindFlowRuns, TakesTheOnlyOnesWhateverTheyAreCalled) {
  add("mine", "AniGenSparseStructureFlowModel");
  add("yours", "AniGenElasticSLatFlowModel");
  const FlowRuns runs = find_flow_runs(folder_.path(), false);
  EXPECT_EQ(runs.structure, folder_ / "mine");
  EXPECT_EQ(runs.latents, folder_ / "yours");
  EXPECT_THROW(find_flow_runs(folder_.path(), true), InputError);
}

TEST_F(FindFlowRuns, LooksOnlyForWhatIsNotKnown) {
  add("a", "AniGenSparseStructureFlowModel");
  add("b", "AniGenSparseStructureFlowModel");
  add("c", "AniGenSLatFlowModel");
  const FlowRuns runs = find_flow_runs(folder_.path(), false, {"elsewhere", {}});
  EXPECT_EQ(runs.structure, "elsewhere");
  EXPECT_EQ(runs.latents, folder_ / "c");
}

TEST_F(FindFlowRuns, RefusesToGuess) {
  EXPECT_THROW(find_flow_runs(folder_ / "nowhere", false), InputError);
  EXPECT_THROW(find_flow_runs(folder_.path(), false), InputError);
  add("a", "AniGenSparseStructureFlowModel");
  add("b", "AniGenSparseStructureFlowModel");
  add("c", "AniGenElasticSLatFlowModel");
  EXPECT_THROW(find_flow_runs(folder_.path(), false), InputError);
}

}  // namespace
}  // namespace anigen::pipeline
