#include "anigen/io/image_probe.h"

#include <algorithm>
#include <cstdlib>

#include "anigen/io/picture_bytes.h"
#include "anigen/io/tiff_directory.h"

namespace anigen::io {
namespace {

PictureSize png_size(const PictureBytes& in) {
  // Chunks: length, type, data, checksum; the last one is IEND.
  for (std::size_t at = 8;; at += static_cast<std::size_t>(in.big_endian(at, 4)) + 12) {
    const std::uint64_t length = in.big_endian(at, 4);
    if (length > in.size() || at + length + 12 > in.size()) in.truncated(in.size());
    if (in.matches(at + 4, "IEND")) break;
  }
  return {true, in.big_endian(16, 4), in.big_endian(20, 4)};
}

PictureSize jpeg_size(const PictureBytes& in) {
  PictureSize size;
  std::size_t at = 2;
  while (true) {
    while (in.big_endian(at, 1) != 0xFF) ++at;  // stray bytes between segments are allowed
    while (in.big_endian(at, 1) == 0xFF) ++at;
    const std::uint64_t marker = in.big_endian(at++, 1);
    if (marker == 0xD9) return size;                                                 // end of image
    if (marker == 0 || marker == 1 || (marker >= 0xD0 && marker <= 0xD7)) continue;  // markers without a length
    const bool is_frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (is_frame) size = {true, in.big_endian(at + 5, 2), in.big_endian(at + 3, 2)};
    at += std::max<std::size_t>(2, static_cast<std::size_t>(in.big_endian(at, 2)));
  }
}

PictureSize bmp_size(const PictureBytes& in) {
  if (in.little_endian(14, 4) == 12) return {true, in.little_endian(18, 2), in.little_endian(20, 2)};
  const auto height = static_cast<std::int32_t>(in.little_endian(22, 4));  // negative: rows from the top
  return {true, in.little_endian(18, 4), static_cast<std::uint64_t>(std::abs(static_cast<std::int64_t>(height)))};
}

PictureSize webp_size(const PictureBytes& in) {
  if (in.matches(12, "VP8X")) return {true, in.little_endian(24, 3) + 1, in.little_endian(27, 3) + 1};
  if (in.matches(12, "VP8L")) {
    const std::uint64_t bits = in.little_endian(21, 4);
    return {true, (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1};
  }
  return {true, in.little_endian(26, 2) & 0x3FFF, in.little_endian(28, 2) & 0x3FFF};
}

PictureSize tiff_size(const PictureBytes& in) {
  const auto width = tiff_value(in, 0, kTiffWidth), height = tiff_value(in, 0, kTiffHeight);
  if (!width || !height) return {};
  return {true, *width, *height};
}

}  // namespace

PictureSize probe_picture(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors) {
  const PictureBytes in(bytes, name_for_errors);
  if (in.matches(0, kPngSignature)) return png_size(in);
  if (in.matches(0, kJpegSignature)) return jpeg_size(in);
  if (in.matches(0, "BM")) return bmp_size(in);
  if (in.matches(0, "RIFF") && in.matches(8, "WEBP")) return webp_size(in);
  if (is_tiff(in, 0)) return tiff_size(in);
  return {};
}

}  // namespace anigen::io
