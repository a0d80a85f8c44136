#pragma once
#include <cstdint>
#include <optional>

#include "anigen/io/picture_bytes.h"

namespace anigen::io {

inline constexpr std::uint64_t kTiffWidth = 256, kTiffHeight = 257, kTiffOrientation = 274;  ///< tags

/// True where a classic TIFF header begins: of a TIFF file, or of the EXIF block inside another format.
bool is_tiff(const PictureBytes& in, std::size_t at);

/// The first value of an integer tag of the first directory (TIFF 6.0, section 2: 8, 16 and 32 bit).
/// @param at where the TIFF header begins @return nothing when the directory lacks the tag, or its value is no integer
/// @throws InputError when the file ends inside the directory
std::optional<std::uint64_t> tiff_value(const PictureBytes& in, std::size_t at, std::uint64_t tag);

}  // namespace anigen::io
