#pragma once
#include <string>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// Which axis of a file points up. Everything is turned to Z up on reading.
enum class Axes { kFormat, kYUp, kZUp };

/// "format", "y-up" or "z-up". @throws InputError on another word
Axes parse_axes(const std::string& word);
const char* name_of(Axes axes);

/// Turns vertices, normals and joints from a Y-up frame to ours: (x, y, z) → (x, −z, y), as the glTF import does.
void from_y_up(RiggedShape& shape);
/// The inverse, (x, y, z) → (x, z, −y): takes back what an import did to a file that was Z up all along.
void to_y_up(RiggedShape& shape);

/// @param format what the reader assumes: the shape still has the file's numbers, and is turned to Z up
void turn_to_z_up(RiggedShape& shape, Axes wanted, Axes format);

}  // namespace anigen::io
