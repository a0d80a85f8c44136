#include "anigen/pipeline/skin_reconstruction.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/state_dict.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

constexpr const char kConfig[] = R"({"models": {"model": {"name": "SkinAutoEncoder", "args": {
  "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 3, "jp_embed_dim": 32,
                     "jp_embedder_config": {"hidden_dim": 32, "depth": 1}},
  "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 1}}}}})";

/// A run folder with a small model of random weights, saved as plain and as averaged weights of which only the
/// averaged ones are right.
class SkinReconstructionTest : public testing::Test {
 protected:
  SkinReconstructionTest() {
    write_file_atomically(folder_ / "config.json", kConfig);
    const Json config = parse_json(kConfig, "test");
    torch::manual_seed(3);
    model_ = models::SkinAutoEncoder(models::SkinAutoEncoderOptions::from_json(config["models"]["model"]["args"]));
    write_weights("model_ema0.9999_step0000010");
    {
      const torch::NoGradGuard no_grad;
      models::SkinAutoEncoder other(model_->options());
      other->encoder()->initialize();
      io::write_safetensors(folder_ / "ckpts" / "model_step0000010.safetensors", models::state_dict(*other));
    }
    Rng rng(5, "reconstruction test");
    joints_ = {{0, 0, 0}, {0.1f, 0.2f, 0}, {0.1f, -0.2f, 0}, {0.3f, 0, 0.2f}};
    for (int v = 0; v < kVertices; ++v) {
      float row[4], sum = 0;
      for (float& w : row) sum += w = static_cast<float>(rng.uniform());
      for (const float w : row) skin_.push_back(w / sum);
    }
  }

  void write_weights(const std::string& name) {
    io::write_safetensors(folder_ / "ckpts" / (name + ".safetensors"), models::state_dict(*model_));
  }

  static constexpr int kVertices = 9000;  // more than one chunk
  test::TemporaryFolder folder_;
  models::SkinAutoEncoder model_ = nullptr;
  std::vector<Eigen::Vector3f> joints_;
  std::vector<int> parents_ = {-1, 0, 0, 2};
  std::vector<float> skin_;
};

TEST_F(SkinReconstructionTest, GivesWhatOneForwardPassGives) {
  SkinReconstruction reconstruction(folder_.path());
  EXPECT_NE(reconstruction.checkpoint().filename().string().find("ema"), std::string::npos);
  const std::vector<float> chunked = reconstruction.reconstruct(joints_, parents_, skin_);

  const torch::NoGradGuard no_grad;
  model_->eval();
  const auto joints = torch::from_blob(joints_.data(), {4, 3}, torch::kFloat32).clone();
  const auto parents = torch::tensor(std::vector<std::int64_t>(parents_.begin(), parents_.end()), torch::kInt64);
  const auto skin = torch::from_blob(skin_.data(), {kVertices, 4}, torch::kFloat32).clone();
  const auto expected = model_->forward({joints}, {parents}, {skin}).skin[0].contiguous();
  ASSERT_EQ(chunked.size(), skin_.size());
  for (std::size_t i = 0; i < chunked.size(); ++i) {
    ASSERT_NEAR(chunked[i], expected.data_ptr<float>()[i], 1e-5f)
        << "entry " << i;  // fp32 rounding of other chunk sizes
  }
}

TEST_F(SkinReconstructionTest, TakesAWeightFileToo) {
  SkinReconstruction from_folder(folder_.path());
  SkinReconstruction from_file(folder_ / "ckpts" / "model_ema0.9999_step0000010.safetensors");
  EXPECT_EQ(from_file.reconstruct(joints_, parents_, skin_), from_folder.reconstruct(joints_, parents_, skin_));
  EXPECT_EQ(from_file.features_per_vertex(), 4);
}

TEST_F(SkinReconstructionTest, RefusesWhatDoesNotFit) {
  EXPECT_THROW(SkinReconstruction(folder_ / "absent"), InputError);
  EXPECT_THROW(SkinReconstruction(folder_.path(), "tpu"), InputError);
  write_file_atomically(folder_ / "config.json", R"({"models": {"denoiser": {"name": "Flow"}}})");
  EXPECT_THROW(SkinReconstruction(folder_.path()), InputError);
}

}  // namespace
}  // namespace anigen::pipeline
