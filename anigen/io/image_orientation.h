#pragma once
#include <cstdint>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::io {

/// How a camera was held, 1 … 8 as the EXIF tag "Orientation" counts: 1 is upright; 5 … 8 exchange width and height.
/// Read from JPEG, PNG (eXIf) and WebP. A picture that says nothing, or nonsense, is upright; so is every TIFF, whose
/// orientation decode_image() has already undone.
int exif_orientation(const std::vector<std::uint8_t>& bytes);

/// The picture turned and mirrored so that it is upright. @param orientation 1 … 8 of the stored picture
/// @throws InputError for another number
Image upright(const Image& stored, int orientation);

}  // namespace anigen::io
