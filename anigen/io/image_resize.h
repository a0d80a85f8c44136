#pragma once
#include <vector>

#include "anigen/io/image.h"

namespace anigen::io {

/// Treatment in a resize of the colour of transparent pixels.
enum class ResizeAlpha {
  /// Colours are multiplied by alpha (8 bit, rounded), filtered, and divided again: what Pillow does with a picture in
  /// mode RGBA. A transparent pixel's colour does not bleed into its neighbours.
  kPremultiplied,
  /// All four channels are filtered on their own: the colours equal those of Pillow's RGB picture with alpha dropped,
  /// the alpha that of its alpha channel alone.
  kSeparate
};

/// Lanczos resize (support 3, widened when shrinking) with the same bytes as Pillow's: horizontal pass, then vertical
/// pass, 22-bit fixed-point coefficients, each pass rounded to 8 bit (docs/reference/flows.md, 5.2). A picture that has
/// the size already comes back untouched.
/// @throws InputError for a picture without pixels, or for a size outside 1 … 16,384
Image resize_lanczos(const Image& image, int width, int height, ResizeAlpha alpha);

/// Pixels [x0, x1) × [y0, y1); may leave the picture.
struct PixelBox {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool operator==(const PixelBox& other) const {
    return x0 == other.x0 && y0 == other.y0 && x1 == other.x1 && y1 == other.y1;
  }
};

/// The part of the picture inside the box; what lies outside the picture is transparent black.
/// @throws InputError when the box is empty or more than 32,768 pixels wide or high
Image crop(const Image& image, const PixelBox& box);

/// The square around the object that training crops condition pictures to: the box of all pixels with alpha > 0
/// (largest minus smallest index), about its centre, enlarged by 1.2, corners cut towards zero
/// (docs/reference/training.md, 1.3).
/// @throws InputError naming `name` when no pixel is visible, or the visible ones lie in one pixel
PixelBox condition_box(const Image& image, const std::string& name = "");

/// The square that generation crops to: alpha > 204, side twice half of int(1.2 · extent) (docs/reference/flows.md,
/// 5.2). Without such a pixel the box of the whole picture.
/// @throws InputError naming `name` when the foreground lies in one pixel
PixelBox inference_box(const Image& image, const std::string& name = "");

/// Pictures as the float planes that networks take: fp32 in [0, 1], one plane per channel, rows from top to bottom.
std::vector<float> color_planes(const Image& image);  ///< [3, H, W]: R, G, B / 255; alpha dropped
std::vector<float> alpha_plane(const Image& image);   ///< [H, W]: A / 255
/// [3, H, W]: (R / 255) · (A / 255) and so on, the picture on black.
std::vector<float> premultiplied_planes(const Image& image);

/// The picture on black as bytes, opaque: trunc(255 · (C / 255) · (A / 255)) in fp32, as the published inference
/// quantises it (docs/reference/flows.md, 5.2).
Image composed_on_black(const Image& image);

}  // namespace anigen::io
