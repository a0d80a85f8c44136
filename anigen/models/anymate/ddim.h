#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// The noise levels of Anymate's diffusion and DDIM's step between them (Song et al. 2021; reference
/// anymate-baselines.md, 3.2): β linear from 1e-4 to 0.02 over all training steps, the network predicts the noise, the
/// predicted data are clamped to [-1, 1] and the noise is not formed again from them, no noise is added (η = 0). With
/// the released 100 steps the last level still holds 60 % of the signal, although sampling starts from noise alone.
class DdimSchedule {
 public:
  /// @param train_steps T @throws InputError unless positive
  explicit DdimSchedule(std::int64_t train_steps = 100);

  /// x_t = √ᾱ_t x_0 + √(1 - ᾱ_t) ε. @param x_0, noise [B, ...] @param t [B] int64 in [0, T) @throws InputError
  Tensor noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t) const;

  /// Levels visited when sampling, from the noisiest: stride T / steps, ending at 0. @throws InputError unless 1 ≤
  /// steps ≤ T
  std::vector<std::int64_t> timesteps(std::int64_t steps) const;

  struct Step {
    Tensor previous;  ///< x at the next, less noisy level
    Tensor x_0;       ///< predicted data, clamped
  };
  /// @param x at level t @param noise predicted there @param stride to the next level; below level 0 lie the data
  Step step(const Tensor& x, const Tensor& noise, std::int64_t t, std::int64_t stride = 1) const;

  std::int64_t train_steps() const { return alphas_cumprod_.size(0); }
  const Tensor& alphas_cumprod() const { return alphas_cumprod_; }  ///< [T] fp32

 private:
  Tensor alphas_cumprod_;
};

}  // namespace anigen::models::anymate
