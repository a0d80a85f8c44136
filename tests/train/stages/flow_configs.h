#pragma once
#include <cmath>
#include <cstdint>
#include <vector>

#include "anigen/io/arrays/npz.h"

namespace anigen::test {

/// A small flow of stage 4 and its training on the published sample: 12 steps of 4 items in 2 micro-batches.
inline constexpr char kStructureFlowConfig[] = R"({
  "models": {"denoiser": {"name": "AniGenSparseStructureFlowModel", "args": {
    "resolution": 2, "in_channels": 8, "in_channels_skl": 4, "out_channels": 8, "out_channels_skl": 4,
    "model_channels": 16, "model_channels_skl": 16, "cond_channels": 12, "num_blocks": 2, "num_heads": 2,
    "mlp_ratio": 2, "patch_size": 1, "qk_rms_norm": true, "use_pretrain_branch": false}}},
  "dataset": {"name": "ImageConditionedAniGenSparseStructureLatent", "args": {
    "latent_model": "ss", "image_size": 8, "eval_split": "held_out.txt"}},
  "trainer": {"name": "AniGenImageConditionedFlowMatchingCFGTrainer", "args": {
    "max_steps": 12, "batch_size": 4, "batch_split": 2, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "ema_rate": [0.9], "fp16_mode": "none",
    "i_log": 4, "i_print": 0, "i_save": 4, "i_eval": 6, "i_sample": 0, "p_uncond": 0.25,
    "t_schedule": {"name": "logitNormal", "args": {"mean": 1.0, "std": 1.0}},
    "sampler": {"steps": 2}, "sample_assets": 1,
    "image_encoder": {"name": "patch", "image_size": 8, "patch_size": 4, "width": 16, "num_blocks": 1,
                      "num_heads": 2}}}})";

/// As above, of stage 5, on box_latents().
inline constexpr char kLatentFlowConfig[] = R"({
  "models": {"denoiser": {"name": "AniGenElasticSLatFlowModel", "args": {
    "resolution": 64, "in_channels": 8, "in_channels_vert_skin": 8, "in_channels_skl": 4,
    "out_channels": 8, "out_channels_vert_skin": 8, "out_channels_skl": 4,
    "model_channels": 16, "model_channels_vert_skin": 12, "model_channels_skl": 8, "cond_channels": 12,
    "num_blocks": 2, "num_heads": 2, "num_heads_vert_skin": 2, "num_heads_skl": 2, "mlp_ratio": 2, "patch_size": 2,
    "io_block_channels": [8], "io_block_channels_vert_skin": [8], "io_block_channels_skl": [8],
    "qk_rms_norm": true, "use_pretrain_branch": false}}},
  "dataset": {"name": "AniGenImageConditionedSLat", "args": {
    "latent_model": "slat", "image_size": 8, "eval_split": "held_out.txt", "load_rigs": false}},
  "trainer": {"name": "AniGenImageConditionedSparseFlowMatchingCFGTrainer", "args": {
    "max_steps": 12, "batch_size": 4, "batch_split": 2, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "ema_rate": [0.9], "fp16_mode": "none",
    "i_log": 4, "i_print": 0, "i_save": 4, "i_eval": 6, "i_sample": 0, "p_uncond": 0.25,
    "t_schedule": {"name": "logitNormal", "args": {"mean": 1.0, "std": 1.0}},
    "sampler": {"steps": 2}, "sample_assets": 1,
    "image_encoder": {"name": "patch", "image_size": 8, "patch_size": 4, "width": 16, "num_blocks": 1,
                      "num_heads": 2}}}})";

/// Latents of the surface of a box of 4 × 4 × (4 + i) voxels with its axis as skeleton; every asset has other latents.
inline io::NamedArrays box_latents(int i) {
  std::vector<std::uint8_t> coords, coords_skl;
  std::vector<float> feats, feats_skl;
  const int high = 33 + i;
  for (int x = 30; x <= 33; ++x) {
    for (int y = 30; y <= 33; ++y) {
      for (int z = 30; z <= high; ++z) {
        const bool inside = x > 30 && x < 33 && y > 30 && y < 33 && z > 30 && z < high;
        if (inside) continue;
        for (const int k : {x, y, z}) coords.push_back(static_cast<std::uint8_t>(k));
        for (int c = 0; c < 16; ++c) feats.push_back(static_cast<float>(std::sin(0.7 * c + 0.4 * x * (i + 1) + z)));
      }
    }
  }
  for (int z = 30; z <= high; ++z) {
    for (const int k : {32, 32, z}) coords_skl.push_back(static_cast<std::uint8_t>(k));
    for (int c = 0; c < 4; ++c) feats_skl.push_back(static_cast<float>(std::cos(1.3 * c + 0.5 * z + i)));
  }
  const auto rows = static_cast<std::int64_t>(coords.size() / 3), rows_skl = std::int64_t{high - 29};
  return {{"coords", io::NdArray::from(coords, {rows, 3})},
          {"feats", io::NdArray::from(feats, {rows, 16})},
          {"coords_skl", io::NdArray::from(coords_skl, {rows_skl, 3})},
          {"feats_skl", io::NdArray::from(feats_skl, {rows_skl, 4})}};
}

}  // namespace anigen::test
