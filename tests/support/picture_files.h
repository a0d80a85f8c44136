#pragma once
#include <array>
#include <cstdint>
#include <vector>

namespace anigen::test {

/// Picture files of kinds that OpenCV reads and does not write.
using FileBytes = std::vector<std::uint8_t>;

/// The EXIF block of nothing but an orientation: a TIFF header and a directory of one entry.
FileBytes exif_block(int orientation, bool big_endian = false);
/// The file with that block where its format keeps it. @param jpeg as encoders write it
FileBytes jpeg_with_exif(const FileBytes& jpeg, const FileBytes& exif);
FileBytes png_with_exif(const FileBytes& png, const FileBytes& exif);

/// 2 × 1 pixels of a palette of two colours, RGBA, whose alpha is stored apart (tRNS).
FileBytes palette_png(const std::array<std::uint8_t, 4>& left, const std::array<std::uint8_t, 4>& right);
/// 8 × 8 pixels of one colour: C, M, Y, K as Adobe's programs store them, 255 for no ink.
FileBytes cmyk_jpeg(const std::array<std::uint8_t, 4>& inks);
/// Uncompressed grey, 8 bit. @param pixels width · height, or fewer for a file that announces more than it holds
FileBytes grey_tiff(std::uint32_t width, std::uint32_t height, const FileBytes& pixels, int orientation = 1);

}  // namespace anigen::test
