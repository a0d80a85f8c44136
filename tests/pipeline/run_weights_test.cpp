#include "anigen/pipeline/run_weights.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/skin_autoencoder.h"
#include "anigen/models/state_dict.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
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
    const models::SkinAutoEncoder model(models::SkinAutoEncoderOptions::from_json(config["models"]["model"]["args"]));
    arrays_ = models::state_dict(*model);
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
}  // namespace anigen::pipeline
