#pragma once
#include <functional>

#include "anigen/models/anymate/ddim.h"

namespace anigen::models::anymate {

/// A network that predicts the noise in a set of joints under the latents of a shape. Neither of the two knows joints
/// by place, so any number of them can be asked for.
class JointDenoiserImpl : public torch::nn::Module {
 public:
  /// @param x [B, 3, N] noisy joints @param t integers, one for each item or one for all @param latents [B, L, W]
  /// @return [B, 3, N] @throws InputError for shapes
  virtual Tensor forward(const Tensor& x, const Tensor& t, const Tensor& latents) = 0;
};

/// One training step's terms.
struct DenoisingTerm {
  Tensor noisy;      ///< [B, 3, N], what the network saw
  Tensor predicted;  ///< [B, 3, N]
  Tensor loss;       ///< scalar: mean squared error of the predicted noise
};

/// The DDPM objective (Ho et al. 2020; reference anymate-baselines.md, 3.2).
/// @param joints [B, N, 3], the real ones repeated in turn (collate_diffusion) @param noise [B, N, 3] normal draws
/// @param t [B] int64 levels, drawn evenly @throws InputError for shapes
DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents, const Tensor& noise, const Tensor& t);

/// The same with noise and levels drawn from torch's default generator.
DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents);

struct DdimSampling {
  std::int64_t steps = 0;  ///< 0: as many as were trained
  /// Called after each step; whatever it throws ends the sampling.
  std::function<void(std::int64_t step, std::int64_t steps)> progress = nullptr;
};

/// Joints from noise by DDIM, without guidance. No gradient is recorded. The released inference then takes
/// merged_joints with eps 0.05. @param noise [B, N, 3] normal draws, any N @param latents [B, L, W] @return [B, N, 3]
Tensor sample_joints(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& latents, const Tensor& noise,
                     const DdimSampling& sampling = {});

/// The sinusoid of t for a network: t flattened to one for each item. @param t one or `items` integers
/// @return [items, width] fp32 @throws InputError for another number
Tensor level_features(const Tensor& t, std::int64_t items, std::int64_t width);

}  // namespace anigen::models::anymate
