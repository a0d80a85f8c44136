#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/nn/torch.h"

namespace anigen::train {

/// Noise that an auto-encoder's trainer mixes into a latent before it is decoded, so that the decoder learns to clean
/// it (paper 3.3; reference training-and-data.md, 3.2).
struct LatentDenoising {
  bool enabled = false;
  double gamma = 1.0;           ///< size of the noise
  double time_max = 0.5;        ///< largest share of noise
  std::int64_t ramp_steps = 0;  ///< steps over which time_max is reached; 0: at once

  /// `latent_denoising`, `latent_denoising_gamma`, `latent_time_max` and `latent_achive_max_step` (spelled so in
  /// published configs), each with `suffix` ("", "_skl") appended.
  static LatentDenoising read(ConfigReader& trainer_args, const std::string& suffix);

  /// Largest share of noise at a step: min(1, step / ramp_steps) · time_max.
  double time_max_at(std::int64_t step) const;
};

/// Where 1 − u is cut off below; the published trainers differ.
inline constexpr double kDenseTimeCut = 1e-8, kSparseTimeCut = 1e-10;

/// Shares of noise (1 − √max(1 − u, cut)) · time_max, whose density falls linearly to 0 at time_max.
/// @param u uniform in [0, 1), one per item @return the shape of u
torch::Tensor latent_times(const torch::Tensor& u, double time_max, double cut = kDenseTimeCut);

/// (1 − t) z + t γ noise. @param z [N, …] @param noise the same shape @param times [N], one per row of z: for a sparse
/// latent those of its items gathered by batch index
torch::Tensor mix_latent_noise(const torch::Tensor& z, const torch::Tensor& noise, const torch::Tensor& times,
                               double gamma);

}  // namespace anigen::train
