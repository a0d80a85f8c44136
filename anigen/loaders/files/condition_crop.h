#pragma once
#include <string>

#include "anigen/io/image.h"

namespace anigen::loaders {

/// Part of a picture, [left, right) × [top, bottom) in pixels; may reach beyond the picture's edges.
struct CropBox {
  int left = 0, top = 0, right = 0, bottom = 0;
};

/// Square around the object of a condition view in training (reference training-and-data.md, 1.4, condition image):
/// bounding box of alpha > 0 in pixel indices, its longer side × 1.2, corners truncated towards zero.
/// @param file for messages @throws InputError when no pixel has alpha > 0, or the object covers so few that nothing
/// is left
CropBox condition_crop(const io::Image& image, const std::string& file);

/// The pixels in the box; what lies outside the picture is transparent black.
io::Image crop(const io::Image& image, const CropBox& box);

}  // namespace anigen::loaders
