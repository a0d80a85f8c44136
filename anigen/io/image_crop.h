#pragma once
#include "anigen/io/image.h"

namespace anigen::io {

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
/// (largest minus smallest index), about its centre, enlarged by 1.2, corners cut towards zero (reference
/// training-and-data.md, 1.4, "Condition image").
/// @throws InputError naming `name` when no pixel is visible, or the visible ones lie in one pixel
PixelBox condition_box(const Image& image, const std::string& name = "");

/// The square that generation crops to: alpha > 204, side twice half of int(1.2 · extent) (reference
/// flows-and-pipeline.md, 5.2). Without such a pixel the box of the whole picture.
/// @throws InputError naming `name` when the foreground lies in one pixel
PixelBox inference_box(const Image& image, const std::string& name = "");

}  // namespace anigen::io
