#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

/// Straight paths between data x₀ (t = 0) and noise ε (t = 1); reference flows-and-pipeline.md, 4.1. All functions take
/// one time per entry of the first axis: [B] for dense latents [B, C, X, Y, Z]; for features [N, C] of a sparse tensor
/// the time of each voxel's batch item, [N].
inline constexpr double kSigmaMin = 1e-5;     ///< what is left of the noise at t = 0
inline constexpr double kTimeScale = 1000.0;  ///< models are given 1000 t

/// x_t = (1 − t) x₀ + (σ + (1 − σ) t) ε
Tensor noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t, double sigma_min = kSigmaMin);
/// v = (1 − σ) ε − x₀ = ∂x_t/∂t: points from data to noise.
Tensor velocity_target(const Tensor& x_0, const Tensor& noise, double sigma_min = kSigmaMin);
/// x₀ = (1 − σ) x_t − (σ + (1 − σ) t) v
Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t, double sigma_min = kSigmaMin);
/// ε = (1 − t) v + x_t
Tensor noise_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t);

/// The same for one time that all entries share, as in a sampler.
Tensor noisy(const Tensor& x_0, const Tensor& noise, double t, double sigma_min = kSigmaMin);
Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, double t, double sigma_min = kSigmaMin);

/// 1000 t, fp32.
Tensor model_time(const Tensor& t);

}  // namespace anigen::flow
