#pragma once
#include <vector>

#include "anigen/io/image.h"

namespace anigen::io {

/// Pictures as the float planes that networks take: fp32 in [0, 1], one plane per channel, rows from top to bottom.
std::vector<float> color_planes(const Image& image);  ///< [3, H, W]: R, G, B / 255; alpha dropped
std::vector<float> alpha_plane(const Image& image);   ///< [H, W]: A / 255
/// [3, H, W]: (R / 255) · (A / 255) and so on, the picture on black.
std::vector<float> premultiplied_planes(const Image& image);

/// The picture on black as bytes, opaque: trunc(255 · (C / 255) · (A / 255)) in fp32, as the published inference
/// quantises it (reference flows-and-pipeline.md, 5.2).
Image composed_on_black(const Image& image);

}  // namespace anigen::io
