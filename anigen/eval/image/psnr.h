#pragma once
#include "anigen/io/image.h"

namespace anigen::eval {

/// Peak signal-to-noise ratio in decibels, 10 log10(1 / mean squared difference), over all pixels and the three colour
/// channels as numbers in [0, 1]; alpha is ignored. Infinite for equal pictures.
/// @throws InputError when the sizes differ or a picture is empty
double psnr(const io::Image& a, const io::Image& b);

}  // namespace anigen::eval
