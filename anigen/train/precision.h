#pragma once
#include <string>

#include "anigen/nn/torch.h"
#include "anigen/train/trainer_options.h"

namespace anigen::train {

/// In which numbers a run computes. Masters, optimiser state and averages are fp32, but for fp64.
struct Precision {
  torch::Dtype compute = torch::kFloat32;  ///< of the torsos (see Stage::set_compute_dtype)
  bool loss_scaling = false;               ///< multiply losses by 2^log_scale: fp16 gradients underflow without
  std::string note;                        ///< one line for the log
};

/// What the trainer arguments `precision`, `fp16_mode` and `loss_scaling` come to on a device:
///
/// | precision | CPU | GPU |
/// |---|---|---|
/// | absent | fp32 | fp32 parameters; losses scaled if fp16_mode and loss_scaling say so |
/// | "fp32" | fp32 | fp32 |
/// | "fp64" | everything in fp64: for comparing ways to sum, stages 1, 4 and 5 | the same |
/// | "bf16" | torsos in bf16 | torsos in bf16 |
/// | "fp16-published" | not supported | torsos in fp16, losses scaled (reference training-and-data.md, 2.4) |
///
/// bf16 has the range of fp32, so its losses are not scaled.
/// @param file of the config, for messages @throws NotSupportedError for fp16 on a CPU; InputError for
/// "fp16-published" beside fp16_mode "none"
Precision choose_precision(const TrainerOptions& options, torch::Device device, const std::string& file);

}  // namespace anigen::train
