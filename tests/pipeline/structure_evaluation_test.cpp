#include "anigen/pipeline/structure_evaluation.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/pipeline/encode_sparse_structure.h"
#include "anigen/train/train_command.h"
#include "tests/loaders/published_sample.h"

namespace anigen::pipeline {
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
    request_.split = folder_ / "test.txt";
    request_.train_split = folder_ / "train.txt";
    request_.out = folder_ / "out";
    request_.strengths = {0.5, 3.0};
  }

  void run(const std::string& name, const char* config) {
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
  for (const char* file : {"metrics.json", "table.md", "samples.png"}) {
    EXPECT_TRUE(std::filesystem::exists(folder_ / "out" / file)) << file;
  }
}

TEST_F(EvaluateStructures, RetrievalFindsAnAssetAmongItsOwnPictures) {
  request_.train_split = folder_ / "test.txt";
  request_.retrieval_views = 2;
  const StructureEvaluation found = evaluate_structures(request_);
  EXPECT_EQ(found.scores[4].front().iou, 1.0);
  EXPECT_EQ(found.scores[5].front().iou, 1.0);
}

TEST_F(EvaluateStructures, TheSameSeedGivesTheSameNumbers) {
  request_.retrieval_views = 0;
  const StructureEvaluation one = evaluate_structures(request_), two = evaluate_structures(request_);
  EXPECT_EQ(one.mean(0).iou, two.mean(0).iou);
  EXPECT_EQ(one.mean(0).iou_skl, two.mean(0).iou_skl);
}

TEST_F(EvaluateStructures, SaysWhatIsMissing) {
  StructureEvaluationRequest request = request_;
  request.split.clear();
  EXPECT_THROW(evaluate_structures(request), InputError);
  request = request_;
  request.autoencoder.clear();
  EXPECT_THROW(evaluate_structures(request), InputError) << "the config names no run of stage 2";
  request = request_;
  request.run = folder_ / "coder";
  EXPECT_THROW(evaluate_structures(request), InputError) << "no flow in there";
}

}  // namespace
}  // namespace anigen::pipeline
