#pragma once
#include <cstdint>
#include <vector>

namespace anigen::generate {

/// Clears the parts of a mask, pixels above 0 that touch each other, also at corners, that have fewer pixels than this
/// share of the largest one. @param mask [height · width] @throws InputError when the mask is of another size
void drop_small_parts(std::vector<std::uint8_t>& mask, int width, int height, double share);

}  // namespace anigen::generate
