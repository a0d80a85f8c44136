#pragma once
#include "anigen/io/image.h"

namespace anigen::eval {

/// @throws InputError when the pictures are not of one size, are empty, or do not hold 4 bytes per pixel
void check_pair(const io::Image& a, const io::Image& b);

}  // namespace anigen::eval
