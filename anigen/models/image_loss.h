#pragma once
#include <functional>

#include "anigen/nn/torch.h"

namespace anigen::models {

// How pictures are compared as losses (reference training-and-data.md, 3.3). Pictures are [N, C, H, W], colours or
// encoded normals in [0, 1]; everything can be differentiated.

/// The 11×11 Gaussian window of SSIM, deviation 1.5 pixels, sum 1. @return [11, 11] fp32
torch::Tensor ssim_window();

/// Structural similarity (Wang et al. 2004) with that window, zeros around the picture, C1 = 0.01², C2 = 0.03² and
/// biased variances, as published: borders count. @return [N], the mean over channels and pixels
/// @throws InputError when the shapes differ
torch::Tensor ssim(const torch::Tensor& a, const torch::Tensor& b);

/// 20 log10(1 / √mse) over everything. Scalar.
torch::Tensor psnr(const torch::Tensor& a, const torch::Tensor& b);

/// Mean angle in degrees between normals encoded as (n + 1)/2; pairs with a zero normal do not count, and without any
/// other it is 0. @param a, b [M, 3]
torch::Tensor normal_angle(const torch::Tensor& a, const torch::Tensor& b);

/// A learned distance of two pictures, such as LPIPS: [N, 3, H, W] twice → any shape, of which the mean counts.
using PictureDistance = std::function<torch::Tensor(const torch::Tensor&, const torch::Tensor&)>;

struct PerceptualOptions {
  double lambda_ssim = 0.2, lambda_lpips = 0.2;
};

/// Scalars; `ssim` is 1 − SSIM. A term whose weight is 0 is undefined and costs nothing.
struct PerceptualLoss {
  torch::Tensor l1, ssim, lpips;
  torch::Tensor total;  ///< l1 + lambda_ssim · ssim + lambda_lpips · lpips
};

/// @param distance asked only when lambda_lpips is not 0 @throws InputError when shapes differ, or when LPIPS is
/// weighted and there is none
PerceptualLoss perceptual_loss(const torch::Tensor& a, const torch::Tensor& b, const PerceptualOptions& options,
                               const PictureDistance& distance);

}  // namespace anigen::models
