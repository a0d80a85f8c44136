#pragma once
#include "anigen/io/image.h"

namespace anigen::eval {

/// Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004), in [-1, 1], 1 for equal pictures: 11 × 11 Gaussian
/// window of standard deviation 1.5 with weights that sum to 1, K1 = 0.01, K2 = 0.03, dynamic range 1, variances
/// weighted by the window (not the unbiased ones). Averaged over the positions where the whole window lies inside the
/// picture, then over the three colour channels, as numbers in [0, 1]; alpha is ignored.
/// @throws InputError when the sizes differ or a side is shorter than 11 pixels
double ssim(const io::Image& a, const io::Image& b);

}  // namespace anigen::eval
