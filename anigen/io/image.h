#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::io {

inline constexpr int kImageChannels = 4;          ///< RGBA
inline constexpr int kMostPixelsPerSide = 16384;  ///< of a picture that is read or resized

/// 8-bit picture, rows from top to bottom, channels interleaved: RGBA.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< 4 · width · height

  Image() = default;
  Image(int width, int height, std::uint32_t rgba_fill = 0xFFFFFFFFu);
  std::uint8_t* pixel(int x, int y) { return rgba.data() + 4 * (static_cast<std::size_t>(y) * width + x); }
  const std::uint8_t* pixel(int x, int y) const { return rgba.data() + 4 * (static_cast<std::size_t>(y) * width + x); }
};

/// Pixel layout of a file.
struct StoredPixels {
  int channels = 0;  ///< 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha; a palette counts as colour
  int bits = 0;      ///< per channel: 8, 16 or 32 (a float); fewer count as 8
};

/// PNG, JPEG or what OpenCV reads. @param stored set, when not null, to what the file held
/// @throws InputError when it cannot be decoded or exceeds 16,384 pixels on a side
Image decode_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                   StoredPixels* stored = nullptr);
Image read_image(const std::filesystem::path& path);
std::vector<std::uint8_t> encode_png(const Image& image);
/// Over white where the picture is transparent. @param quality 1 … 100
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);
void write_png(const std::filesystem::path& path, const Image& image);  ///< atomic

struct PictureSize {
  bool known = false;  ///< false for formats other than PNG, JPEG, BMP, WebP and TIFF
  std::uint64_t width = 0, height = 0;
};

/// Size in pixels from the header alone, so that a hostile one is refused before anything is allocated; also notices
/// PNG and JPEG files that end too early, which decoders may fill with grey.
/// @throws InputError when the header is cut short or the file is truncated
PictureSize probe_picture(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors);

/// Orientation of a camera, 1 … 8 as the EXIF tag "Orientation" counts: 1 is upright; 5 … 8 exchange width and height.
/// Read from JPEG, PNG (eXIf) and WebP. A picture that says nothing, or nonsense, is upright; so is every TIFF, whose
/// orientation decode_image() has already undone.
int exif_orientation(const std::vector<std::uint8_t>& bytes);

/// The picture turned and mirrored so that it is upright. @param orientation 1 … 8 of the stored picture
/// @throws InputError for another number
Image upright(const Image& stored, int orientation);

/// The bytes of a picture file, read with a bounds check, so that every header can be walked without thinking about
/// its end. Holds references only.
class PictureBytes {
 public:
  PictureBytes(const std::vector<std::uint8_t>& bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  /// @throws InputError naming the byte when the file ends before it; so does little_endian
  std::uint64_t big_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i) value = value << 8 | byte(at + i);
    return value;
  }
  std::uint64_t little_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = count; i-- > 0;) value = value << 8 | byte(at + i);
    return value;
  }
  bool matches(std::size_t at, std::string_view text) const {
    return at + text.size() <= bytes_.size() &&
           std::equal(text.begin(), text.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                      [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
  }
  std::size_t size() const { return bytes_.size(); }
  [[noreturn]] void truncated(std::size_t at) const {
    throw InputError(name_, "byte " + std::to_string(at), "picture file is cut short");
  }

 private:
  std::uint8_t byte(std::size_t at) const {
    if (at >= bytes_.size()) truncated(at);
    return bytes_[at];
  }
  const std::vector<std::uint8_t>& bytes_;
  const std::string& name_;
};

inline constexpr std::string_view kPngSignature = "\x89PNG\r\n\x1a\n";
inline constexpr std::string_view kJpegSignature = "\xff\xd8\xff";

inline constexpr std::uint64_t kTiffWidth = 256, kTiffHeight = 257, kTiffOrientation = 274;  ///< tags

/// True where a classic TIFF header begins: of a TIFF file, or of the EXIF block inside another format.
bool is_tiff(const PictureBytes& in, std::size_t at);

/// The first value of an integer tag of the first directory (TIFF 6.0, section 2: 8, 16 and 32 bit).
/// @param at where the TIFF header begins @return nothing when the directory lacks the tag, or its value is no integer
/// @throws InputError when the file ends inside the directory
std::optional<std::uint64_t> tiff_value(const PictureBytes& in, std::size_t at, std::uint64_t tag);

}  // namespace anigen::io
