#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/run_weights.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "tests/support/paths.h"

namespace anigen::generate {

namespace {

constexpr const char kRunConfig[] = R"({"models": {"model": {"name": "SkinAutoEncoder", "args": {
  "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 3, "jp_embed_dim": 32,
                     "jp_embedder_config": {"hidden_dim": 32, "depth": 1}},
  "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 1}}},
  "other": {"name": "Elsewhere", "args": {}}}})";

class RunWeights : public testing::Test {
 protected:
  RunWeights() {
    write_file_atomically(folder_ / "config.json", kRunConfig);
    const Json config = parse_json(kRunConfig, "test");
    const skin_field::SkinAutoEncoder model(
        skin_field::SkinAutoEncoderOptions::from_json(config["models"]["model"]["args"]));
    arrays_ = nn::state_dict(*model);
  }
  Json model() {
    io::write_safetensors(folder_ / "ckpts" / "model_step0000010.safetensors", arrays_);
    return describe_weights(folder_.path())["model"];
  }

  test::TemporaryFolder folder_;
  io::NamedArrays arrays_;
};

TEST_F(RunWeights, ACompleteCheckpoint) {
  const Json found = model();
  EXPECT_EQ(found["complete"], true);
  EXPECT_EQ(found["tensors"], arrays_.size());
  EXPECT_EQ(found["checkpoint"], "model_step0000010.safetensors");
  EXPECT_FALSE(found.contains("missing"));
  EXPECT_EQ(first_incomplete({{"model", found}}), "");
}

TEST_F(RunWeights, NamesWhatIsMissingWhatIsTooMuchAndWhatHasAnotherShape) {
  const std::string lost = arrays_.back().first, changed = arrays_.front().first;
  arrays_.pop_back();
  arrays_.front().second = io::NdArray::from<float>({1, 2, 3}, {3});
  arrays_.emplace_back("stray", io::NdArray::from<float>({1}, {1}));
  const Json found = model();
  EXPECT_EQ(found["complete"], false);
  EXPECT_EQ(found["missing"], (Json{{"count", 1}, {"first", lost}}));
  EXPECT_EQ(found["misshapen"], (Json{{"count", 1}, {"first", changed}}));
  EXPECT_EQ(found["unexpected"], (Json{{"count", 1}, {"first", "stray"}}));
  EXPECT_EQ(first_incomplete({{"model", found}}),
            "model, model_step0000010.safetensors: 1 missing tensors, the first " + lost);
}

TEST_F(RunWeights, SaysWhyThereIsNothingToCompare) {
  const Json found = describe_weights(folder_.path());
  EXPECT_EQ(found["model"]["complete"], false);
  EXPECT_NE(found["model"]["problem"].get<std::string>(), "");
  EXPECT_NE(found["other"]["problem"].get<std::string>().find("not known"), std::string::npos);
  EXPECT_THROW(describe_weights(folder_ / "nowhere"), InputError);
}

}  // namespace

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
    for (const char* name : {"ss_flow_duet", "ss_flow_epic", "ss_flow_solo"})
      add(root + "/" + name, "AniGenSparseStructureFlowModel");
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

}  // namespace anigen::generate
