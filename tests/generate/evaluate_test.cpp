#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/generate/encode_report.h"
#include "anigen/generate/evaluate.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/train_command.h"
#include "tests/support/paths.h"
#include "tests/train/stages/published_sample.h"

namespace anigen::generate {

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
    model_ =
        skin_field::SkinAutoEncoder(skin_field::SkinAutoEncoderOptions::from_json(config["models"]["model"]["args"]));
    write_weights("model_ema0.9999_step0000010");
    {
      const torch::NoGradGuard no_grad;
      skin_field::SkinAutoEncoder other(model_->options());
      other->encoder()->initialize();
      io::write_safetensors(folder_ / "ckpts" / "model_step0000010.safetensors", nn::state_dict(*other));
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
    io::write_safetensors(folder_ / "ckpts" / (name + ".safetensors"), nn::state_dict(*model_));
  }

  static constexpr int kVertices = 9000;  // more than one chunk
  test::TemporaryFolder folder_;
  skin_field::SkinAutoEncoder model_ = nullptr;
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

namespace {

constexpr const char kCoderConfig[] = R"({
  "models": {
    "encoder": {"name": "AniGenSparseStructureEncoder", "args": {
      "latent_channels": 8, "latent_channels_skl": 4, "num_res_blocks": 1, "num_res_blocks_middle": 0,
      "channels": [4, 8], "encode_global_skl": false, "use_pretrain_branch": false}},
    "decoder": {"name": "AniGenSparseStructureDecoder", "args": {
      "latent_channels": 8, "latent_channels_skl": 4, "num_res_blocks": 1, "num_res_blocks_middle": 0,
      "channels": [8, 4], "encode_global_skl": false, "use_pretrain_branch": false, "normalize_z_skl": false}}},
  "dataset": {"name": "AniGenSparseStructure", "args": {"resolution": 8}},
  "trainer": {"name": "AniGenSparseStructureVaeTrainer", "args": {
    "max_steps": 2, "batch_size": 2, "seed": 5, "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_print": 0, "i_save": 2, "i_eval": 0, "i_sample": 0}}})";

constexpr const char kStructureFlowConfig[] = R"({
  "models": {"denoiser": {"name": "AniGenSparseStructureFlowModel", "args": {
    "resolution": 4, "in_channels": 8, "in_channels_skl": 4, "out_channels": 8, "out_channels_skl": 4,
    "model_channels": 16, "model_channels_skl": 16, "cond_channels": 12, "num_blocks": 1, "num_heads": 2,
    "mlp_ratio": 2, "patch_size": 1, "use_pretrain_branch": false}}},
  "dataset": {"name": "ImageConditionedAniGenSparseStructureLatent", "args": {
    "latent_model": "coder", "image_size": 8}},
  "trainer": {"name": "AniGenImageConditionedFlowMatchingCFGTrainer", "args": {
    "max_steps": 2, "batch_size": 2, "seed": 5, "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_print": 0, "i_save": 2, "i_eval": 0, "i_sample": 0,
    "sampler": {"steps": 2, "cfg_strength": 1.5},
    "image_encoder": {"name": "patch", "image_size": 8, "patch_size": 4, "width": 16, "num_blocks": 1,
                      "num_heads": 2}}}})";

class EvaluateStructures : public testing::Test {
 protected:
  EvaluateStructures() {
    write_file_atomically(folder_ / "test.txt", test::PublishedSample::id(2) + "\n");
    write_file_atomically(folder_ / "train.txt", test::PublishedSample::id(0) + "\n" + test::PublishedSample::id(1));
    run("coder", kCoderConfig);
    EncodeRequest encode;
    encode.run = folder_ / "coder";
    encode.data = sample_.root();
    encode_sparse_structure(encode);
    run("flow", kStructureFlowConfig);
    request_.run = folder_ / "flow";
    request_.autoencoder = folder_ / "coder";
    request_.data = sample_.root().string();
    request_.splits = {folder_ / "test.txt"};
    request_.train_split = folder_ / "train.txt";
    request_.out = folder_ / "out";
    request_.strengths = {0.0, 0.5, 3.0};
  }

  void run(const std::string& name, const std::string& config) {
    write_file_atomically(folder_ / (name + ".json"), config);
    train::TrainCommand command;
    command.config = folder_ / (name + ".json");
    command.data_dir = sample_.root().string();
    command.run.output = folder_ / name;
    command.command_line = "anigen-train";
    train::train(command);
  }

  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
  StructureEvaluationRequest request_;
};

TEST_F(EvaluateStructures, ComparesTheFlowWithRetrievalAndTheAutoEncoder) {
  const StructureEvaluation found = evaluate_structures(request_);
  const std::vector<std::string> methods{"flow, not guided", "flow, guidance 0.5",  "flow, guidance 3.0",
                                         "auto-encoder",     "retrieval by colour", "retrieval by tokens",
                                         "ground truth"};
  EXPECT_EQ(found.methods, methods);
  ASSERT_EQ(found.ids, std::vector<std::string>{test::PublishedSample::id(2)});
  const StructureScore truth = found.scores.back().front();
  EXPECT_EQ(truth.iou, 1.0);
  EXPECT_EQ(truth.iou_skl, 1.0);
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const StructureScore s = found.mean(m);
    for (const double value : {s.iou, s.f1, s.iou_skl, s.f1_skl, s.inside}) {
      EXPECT_GE(value, 0.0) << methods[m];
      EXPECT_LE(value, 1.0) << methods[m];
    }
  }
  const CsvTable rows = read_csv(folder_ / "out" / "metrics.csv");
  EXPECT_EQ(rows.rows.size(), methods.size());
  for (const char* file : {"metrics.json", "table.md", "samples.png"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / "out" / file)) << file;
}

TEST_F(EvaluateStructures, SeveralSplitsAreTakenTogether) {
  request_.retrieval_views = 0;
  request_.pictured = 0;
  request_.strengths = {0.5};
  write_file_atomically(folder_ / "two.txt", test::PublishedSample::id(2) + "\n" + test::PublishedSample::id(0) + "\n");
  request_.splits.push_back(folder_ / "two.txt");
  const StructureEvaluation found = evaluate_structures(request_);
  // An asset that both files name counts once; order is that of the dataset's table.
  EXPECT_EQ(found.ids, (std::vector<std::string>{test::PublishedSample::id(0), test::PublishedSample::id(2)}));
  EXPECT_EQ(found.scores.front().size(), 2u);
  EXPECT_EQ(found.settings["splits"], Json({(folder_ / "test.txt").string(), (folder_ / "two.txt").string()}));
  // One of the splits holds what the other names, so both together are the larger one, to the last digit.
  request_.splits = {folder_ / "two.txt"};
  EXPECT_EQ(evaluate_structures(request_).mean(0).iou, found.mean(0).iou);
}

TEST_F(EvaluateStructures, WithoutPicturesThereIsNoSheet) {
  request_.retrieval_views = 0;
  request_.pictured = 0;
  evaluate_structures(request_);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out" / "table.md"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out" / "samples.png"));
}

TEST_F(EvaluateStructures, RetrievalFindsAnAssetAmongItsOwnPictures) {
  request_.train_split = folder_ / "test.txt";
  request_.retrieval_views = 2;
  const StructureEvaluation found = evaluate_structures(request_);
  EXPECT_EQ(found.scores[4].front().iou, 1.0);
  EXPECT_EQ(found.scores[5].front().iou, 1.0);
}

TEST_F(EvaluateStructures, RetrievalLeavesOutWhatTheTrainingHeldOut) {
  // A flow that was trained on two of the three assets.
  std::string config = kStructureFlowConfig;
  const std::string at = "\"image_size\": 8}},";
  config.insert(config.find(at) + at.find('}'), ", \"eval_split\": \"" + (folder_ / "test.txt").string() + "\"");
  run("held", config);
  request_.run = folder_ / "held";
  request_.train_split.clear();
  request_.retrieval_views = 2;
  EXPECT_EQ(evaluate_structures(request_).methods.size(), 7u) << "the two are chosen from";
  request_.splits = {folder_ / "train.txt"};
  EXPECT_THROW(evaluate_structures(request_), InputError) << "neither these nor the one that was held out";
  request_.retrieval_views = 0;
  EXPECT_EQ(evaluate_structures(request_).ids.size(), 2u);
}

TEST_F(EvaluateStructures, TheSameSeedGivesTheSameNumbers) {
  request_.retrieval_views = 0;
  const StructureEvaluation one = evaluate_structures(request_), two = evaluate_structures(request_);
  EXPECT_EQ(one.mean(0).iou, two.mean(0).iou);
  EXPECT_EQ(one.mean(0).iou_skl, two.mean(0).iou_skl);
}

TEST_F(EvaluateStructures, SaysWhatIsMissing) {
  StructureEvaluationRequest request = request_;
  request.splits.clear();
  EXPECT_THROW(evaluate_structures(request), InputError);
  request = request_;
  request.autoencoder.clear();
  EXPECT_THROW(evaluate_structures(request), InputError) << "the config names no run of stage 2";
  request = request_;
  request.run = folder_ / "coder";
  EXPECT_THROW(evaluate_structures(request), InputError) << "no flow in there";
}

}  // namespace

}  // namespace anigen::generate
