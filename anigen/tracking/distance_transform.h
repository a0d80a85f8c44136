#pragma once
#include <cstdint>
#include <vector>

namespace anigen::tracking {

/// Exact Euclidean distance of every pixel's centre from the centre of the nearest marked pixel (Felzenszwalb and
/// Huttenlocher, "Distance Transforms of Sampled Functions", 2012).
/// @param marked [height · width], 0: not marked
/// @return [height · width] pixels; 0 where marked, infinite everywhere when nothing is
/// @throws InputError when the pixels do not fit the size
std::vector<double> distance_transform(const std::vector<std::uint8_t>& marked, int width, int height);

}  // namespace anigen::tracking
