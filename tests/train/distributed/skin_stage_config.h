#pragma once

namespace anigen::test {

/// Stage 1, small, on a dataset of write_synthetic_dataset(): 12 steps of 4 micro-batches.
inline constexpr char kSkinStageConfig[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 16,
                       "jp_embedder_config": {"hidden_dim": 16, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {"test_mode": false}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 12, "batch_size": 4, "batch_split": 4, "num_skin_samples": 32, "seed": 7,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.001}},
    "grad_clip": {"name": "AdaptiveGradClipper", "args": {"max_norm": 1.0, "buffer_size": 20}},
    "ema_rate": [0.99], "fp16_mode": "none", "i_log": 3, "i_print": 0, "i_save": 20, "i_sample": 0, "i_ddpcheck": 2,
    "augmentations": {"rotation": "so3", "merge_joints": 0.3}}}})";

}  // namespace anigen::test
