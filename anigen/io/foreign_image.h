#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::io {

/// decode_image() in a process of its own without rights (core/sandbox.h), for pictures of strangers: decoders of
/// pictures are libraries in which faults are found every year, and what one does to its process harms nobody there.
/// The process has 20 s and a second per 4 million pixels of processor time, and memory for the announced size. It
/// takes some milliseconds more than decode_image(), so pictures that this project made are decoded by that.
/// @throws InputError, NotSupportedError as decode_image() does; InputError when the decoder crashes, or takes more
Image decode_foreign_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                           StoredPixels* stored = nullptr);

}  // namespace anigen::io
