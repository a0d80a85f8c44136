#pragma once
#include <cstdint>
#include <filesystem>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/patch_encoder.h"

namespace anigen::test {

/// Pixels along a side of the pictures that give_image_encoder()'s flows see.
inline constexpr int kConditionSide = 32;

/// Makes a run of a flow one without images that takes two steps. @param trainer changes of its arguments
inline void make_rig_flow(const std::filesystem::path& run, const char* dataset, const Json& trainer) {
  Json config = read_json(run / "config.json");
  config["dataset"]["name"] = dataset;
  config["dataset"]["args"].erase("image_size");
  config["trainer"]["args"].update(trainer);
  config["trainer"]["args"]["sampler"] = {{"steps", 2}, {"cfg_strength", 0.0}};
  write_file_atomically(run / "config.json", config.dump(2));
}

/// A flow's run with a small image encoder in place of DINOv2.
inline void give_image_encoder(const std::filesystem::path& run) {
  Json config = read_json(run / "config.json");
  const std::int64_t channels = config["models"]["denoiser"]["args"]["cond_channels"];
  const Json encoder = {{"name", "patch"},  {"image_size", kConditionSide},
                        {"patch_size", 16}, {"width", 16},
                        {"num_blocks", 1},  {"num_heads", 2}};
  config["dataset"]["args"]["image_size"] = kConditionSide;
  config["trainer"]["args"]["image_encoder"] = encoder;
  config["trainer"]["args"]["sampler"] = {{"steps", 3}, {"cfg_strength", 1.0}};
  write_file_atomically(run / "config.json", config.dump(2));
  torch::manual_seed(0);
  vision::PatchImageEncoder model(vision::PatchImageEncoderOptions::from_json(encoder), channels);
  io::write_safetensors(run / "ckpts" / "image_encoder_final.safetensors", nn::state_dict(*model));
}

}  // namespace anigen::test
