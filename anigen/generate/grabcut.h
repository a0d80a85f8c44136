#pragma once
#include <cstdint>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::generate {

/// False in a build without OpenCV.
bool has_grabcut();

/// The object of an opaque picture without a trained network: GrabCut (Rother et al. 2004, OpenCV), begun from how far
/// every colour is from those along the picture's edge, on a copy of at most 512 pixels a side. Right for an object
/// that stands clear of a background with few colours; parts that share the background's colour are lost. Parts below a
/// twentieth of the largest one are dropped. Deterministic.
/// @param image alpha is ignored
/// @return [H · W] alpha 0 … 255; all 0 when nothing stands out
/// @throws NotSupportedError in a build without OpenCV
std::vector<std::uint8_t> grabcut_mask(const io::Image& image);

}  // namespace anigen::generate
