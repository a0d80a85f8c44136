#pragma once
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/train/stages/published_sample.h"

namespace anigen::test {

/// Stage 2, small, on write_ball_dataset(): 8 steps of 4 items in 2 micro-batches.
inline constexpr char kBallConfig[] = R"({
  "models": {
    "encoder": {"name": "AniGenSparseStructureEncoder", "args": {
      "latent_channels": 4, "latent_channels_skl": 3, "num_res_blocks": 1, "num_res_blocks_middle": 0,
      "channels": [4, 8], "encode_global_skl": false, "use_pretrain_branch": false}},
    "decoder": {"name": "AniGenSparseStructureDecoder", "args": {
      "latent_channels": 4, "latent_channels_skl": 3, "num_res_blocks": 1, "num_res_blocks_middle": 0,
      "channels": [8, 4], "encode_global_skl": false, "use_pretrain_branch": false, "normalize_z_skl": false}}},
  "dataset": {"name": "AniGenSparseStructure", "args": {
    "resolution": 16, "skl_dilation_iter": 1, "eval_split": "splits/test.txt"}},
  "trainer": {"name": "AniGenSparseStructureVaeTrainer", "args": {
    "max_steps": 8, "batch_size": 4, "batch_split": 2, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.01}},
    "grad_clip": {"name": "AdaptiveGradClipper", "args": {"max_norm": 1.0, "buffer_size": 4}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_log": 1, "i_print": 0, "i_save": 3, "i_eval": 4, "i_sample": 0,
    "loss_type": "dice", "latent_denoising_skl": true, "latent_time_max_skl": 0.25,
    "latent_achive_max_step_skl": 4}}})";

/// A dataset of occupancy in the published layout, to be read at resolution 16: ball0, ball1, … are spheres of growing
/// radius whose skeleton is a rod through the centre. splits/test.txt holds the last two.
inline void write_ball_dataset(const std::filesystem::path& root, int count) {
  constexpr int kEdge = 16;
  std::filesystem::create_directories(root / "voxels");
  std::filesystem::create_directories(root / "splits");
  std::ofstream csv(root / "metadata.csv"), split(root / "splits" / "test.txt");
  csv << "sha256,aesthetic_score,voxelized,num_voxels\n";
  for (int i = 0; i < count; ++i) {
    const std::string id = "ball" + std::to_string(i);
    const double radius = 3.0 + 4.0 * i / count;
    std::vector<std::array<double, 3>> surface, skeleton;
    // An index k of the 64³ grid has its centre at that of cell c of the 16³ grid when k = 4 c + 1.5.
    const auto place = [](int c) { return 4.0 * c + 1.5; };
    for (int x = 0; x < kEdge; ++x) {
      for (int y = 0; y < kEdge; ++y) {
        for (int z = 0; z < kEdge; ++z) {
          const double distance = std::hypot(x - 7.5, y - 7.5, z - 7.5);
          if (std::abs(distance - radius) < 0.7) surface.push_back({place(x), place(y), place(z)});
        }
      }
      if (std::abs(x - 7.5) < radius) skeleton.push_back({place(x), place(7), place(8)});
    }
    PublishedSample::write_centres(root / "voxels" / (id + ".ply"), surface);
    PublishedSample::write_centres(root / "voxels" / (id + "_skeleton.ply"), skeleton);
    csv << id << ",6.5,True," << surface.size() << "\n";
    if (i + 2 >= count) split << id << "\n";
  }
}

}  // namespace anigen::test
