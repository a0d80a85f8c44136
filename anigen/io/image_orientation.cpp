#include "anigen/io/image_orientation.h"

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/io/tiff_directory.h"

namespace anigen::io {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::string_view kExifPrefix = "Exif\0\0"sv;
constexpr int kUpright = 1, kOrientations = 8;

// Where the EXIF block begins: its TIFF header.
std::optional<std::size_t> in_jpeg(const PictureBytes& in) {
  for (std::size_t at = 2; in.big_endian(at, 1) == 0xFF;) {
    const std::uint64_t marker = in.big_endian(at + 1, 1);
    if (marker == 0xFF) {  // a fill byte
      ++at;
      continue;
    }
    if (marker == 0xDA || marker == 0xD9) return std::nullopt;  // the picture itself begins, or ends
    if (marker == 0xE1 && in.matches(at + 4, kExifPrefix)) return at + 4 + kExifPrefix.size();
    at += 2 + static_cast<std::size_t>(in.big_endian(at + 2, 2));
  }
  return std::nullopt;
}

std::optional<std::size_t> in_png(const PictureBytes& in) {
  for (std::size_t at = kPngSignature.size(); at < in.size();) {
    if (in.matches(at + 4, "eXIf")) return at + 8;
    at += static_cast<std::size_t>(in.big_endian(at, 4)) + 12;  // length, type, data, checksum
  }
  return std::nullopt;
}

std::optional<std::size_t> in_webp(const PictureBytes& in) {
  for (std::size_t at = 12; at + 8 <= in.size();) {
    if (in.matches(at, "EXIF")) {
      const std::size_t block = at + 8;
      return in.matches(block, kExifPrefix) ? block + kExifPrefix.size() : block;  // some writers keep JPEG's prefix
    }
    const auto length = static_cast<std::size_t>(in.little_endian(at + 4, 4));
    at += 8 + length + length % 2;
  }
  return std::nullopt;
}

std::optional<std::size_t> exif_block(const PictureBytes& in) {
  if (in.matches(0, kJpegSignature)) return in_jpeg(in);
  if (in.matches(0, kPngSignature)) return in_png(in);
  if (in.matches(0, "RIFF") && in.matches(8, "WEBP")) return in_webp(in);
  return std::nullopt;
}

}  // namespace

int exif_orientation(const std::vector<std::uint8_t>& bytes) {
  const std::string no_name;
  const PictureBytes in(bytes, no_name);
  try {
    const std::optional<std::size_t> block = exif_block(in);
    if (!block || !is_tiff(in, *block)) return kUpright;
    const std::uint64_t value = tiff_value(in, *block, kTiffOrientation).value_or(kUpright);
    return value >= 1 && value <= kOrientations ? static_cast<int>(value) : kUpright;
  } catch (const InputError&) {
    return kUpright;  // a damaged remark is no reason to refuse a picture
  }
}

Image upright(const Image& stored, int orientation) {
  if (orientation < 1 || orientation > kOrientations) {
    throw InputError("", "", "orientation " + std::to_string(orientation) + " of a picture; EXIF has 1 … 8");
  }
  if (orientation == kUpright) return stored;
  const bool exchanged = orientation >= 5;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  Image result(exchanged ? stored.height : stored.width, exchanged ? stored.width : stored.height);
  for (int y = 0; y < result.height; ++y) {
    for (int x = 0; x < result.width; ++x) {
      const int across = exchanged ? y : x, down = exchanged ? x : y;
      const std::uint8_t* from =
          stored.pixel(from_right ? stored.width - 1 - across : across, from_below ? stored.height - 1 - down : down);
      std::copy_n(from, kImageChannels, result.pixel(x, y));
    }
  }
  return result;
}

}  // namespace anigen::io
