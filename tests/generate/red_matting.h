#pragma once
#include <filesystem>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/matting.h"

namespace anigen::test {

/// A run of a matting network whose weights are made by hand: pixels whose red stands out from the rest of the picture
/// are the object, with alpha 1, all others have alpha 0. It sees 64 × 64 pixels.
inline void write_red_matting(const std::filesystem::path& run) {
  const torch::NoGradGuard no_grad;
  vision::MattingUNetOptions options;
  options.image_size = options.width = 64;
  options.num_blocks = 0;
  vision::MattingUNet model(options);
  for (torch::Tensor parameter : model->parameters()) parameter.zero_();
  const std::int64_t channels = options.map_channels();
  for (auto& entry : model->named_parameters()) {
    torch::Tensor& values = entry.value();
    // One channel holds the picture's red, and after its norm how far that stands out, in deviations.
    if (entry.key() == "detail.weight") values[0][channels][1][1].fill_(1.0);
    if (entry.key() == "fine.weight") values[0][0][1][1].fill_(20.0);
    if (entry.key() == "fine.bias") values.fill_(-10.0);
  }
  const Json config = {{"models", {{"matting", {{"name", vision::kMattingUNetClass}, {"args", options.to_json()}}}}}};
  std::filesystem::create_directories(run / "ckpts");
  write_file_atomically(run / "config.json", config.dump(2));
  io::write_safetensors(run / "ckpts/matting_step0000001.safetensors", nn::state_dict(*model));
}

}  // namespace anigen::test
