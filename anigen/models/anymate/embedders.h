#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

inline constexpr std::int64_t kHarmonics = 25;  ///< real spherical harmonics up to degree 4

/// [x, sin(f_k x_d), cos(f_k x_d)] with f_k = 2^k, k = 0 … num_freqs - 1, times π if asked for; all k of the first
/// coordinate, then of the next; all sines before all cosines (reference anymate-baselines.md, 2.1). Differs from
/// nn::FourierEmbedding in frequencies and order.
/// @param x [..., D] floating @return [..., fourier_width(num_freqs, D)], dtype of x
Tensor fourier_features(const Tensor& x, std::int64_t num_freqs, bool include_pi);
inline std::int64_t fourier_width(std::int64_t num_freqs, std::int64_t dims = 3) { return dims * (2 * num_freqs + 1); }

/// Real spherical harmonics of a direction, degree by degree; the direction is taken as it is, not normalised
/// (reference anymate-baselines.md, 2.1). @param directions [..., 3] floating @return [..., 25], its dtype
Tensor spherical_harmonics(const Tensor& directions);

}  // namespace anigen::models::anymate
