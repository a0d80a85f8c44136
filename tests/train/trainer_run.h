#pragma once
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/train/train_command.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {

/// Config of a small stage 1, in twelve steps.
inline constexpr char kRunConfig[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 16,
                       "jp_embedder_config": {"hidden_dim": 16, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {"test_mode": false, "eval_fraction": 0.2}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 12, "batch_size": 4, "batch_split": 2, "num_skin_samples": 32, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
    "lr_scheduler": {"name": "SequentialLR", "args": {"milestones": [3]}, "schedulers": [
      {"name": "LinearLR", "args": {"start_factor": 0.1, "total_iters": 3}},
      {"name": "CosineAnnealingLR", "args": {"T_max": 9}}]},
    "grad_clip": {"name": "AdaptiveGradClipper", "args": {"max_norm": 1.0, "buffer_size": 4}},
    "ema_rate": [0.99, 0.9], "fp16_mode": "none", "i_log": 5, "i_print": 0, "i_save": 4, "i_eval": 6, "i_sample": 0,
    "augmentations": {"rotation": "so3", "merge_joints": 0.3}}}})";

/// A folder with that config and ten rigs.
class TrainerRun : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_synthetic_dataset(folder_ / "data", 10);
    std::ofstream(folder_ / "config.json") << kRunConfig;
  }
  TrainCommand command(const std::string& output, std::vector<std::string> overrides = {}) {
    return test::train_command(folder_, output, std::move(overrides));
  }
  std::string bytes(const std::string& file) { return read_file(folder_ / file); }
  test::TemporaryFolder folder_;
};

}  // namespace anigen::train
