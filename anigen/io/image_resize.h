#pragma once
#include "anigen/io/image.h"

namespace anigen::io {

/// How a resize treats the colour of transparent pixels.
enum class ResizeAlpha {
  /// Colours are multiplied by alpha (8 bit, rounded), filtered, and divided again: what Pillow does with a picture in
  /// mode RGBA. A transparent pixel's colour does not bleed into its neighbours.
  kPremultiplied,
  /// All four channels are filtered on their own: the colours equal those of Pillow's RGB picture with alpha dropped,
  /// the alpha that of its alpha channel alone.
  kSeparate
};

/// Lanczos resize (support 3, widened when shrinking) with the same bytes as Pillow's: horizontal pass, then vertical
/// pass, 22-bit fixed-point coefficients, each pass rounded to 8 bit (reference flows-and-pipeline.md, 5.2, "PIL
/// details"). A picture that has the size already comes back untouched.
/// @throws InputError for a picture without pixels, or for a size outside 1 … 16,384
Image resize_lanczos(const Image& image, int width, int height, ResizeAlpha alpha);

}  // namespace anigen::io
