#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

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

/// Picture of one channel of 16 bits, rows from top to bottom.
struct Grey16 {
  int width = 0, height = 0;
  std::vector<std::uint16_t> values;  ///< width · height
};

/// PNG, JPEG, WebP, BMP or TIFF; lean builds read neither WebP nor TIFF.
/// @param stored set, when not null, to what the file held
/// @throws InputError when it is none of these, cannot be decoded or exceeds 16,384 pixels on a side;
/// NotSupportedError for what a lean build does not read
Image decode_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                   StoredPixels* stored = nullptr);
/// @throws as decode_image, and InputError for other pixels than one channel of 16 bits
Grey16 decode_grey16(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors);
Image read_image(const std::filesystem::path& path);
/// True when at least one pixel is not fully opaque: only then the published pipeline trusts alpha
/// (docs/reference/flows.md, 5.2).
bool has_transparency(const Image& image);
/// Pictures directly in a folder, by name: png, jpg, jpeg, webp, bmp, tif, tiff.
/// @throws InputError when there is none, or no such folder
std::vector<std::filesystem::path> picture_files(const std::filesystem::path& folder);
std::vector<std::uint8_t> encode_png(const Image& image);
std::vector<std::uint8_t> encode_png16(const Grey16& grey);
/// Over white where the picture is transparent. @param quality 1 … 100
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);
void write_png(const std::filesystem::path& path, const Image& image);  ///< atomic

struct PictureSize {
  bool known = false;  ///< false for formats other than PNG, JPEG, BMP, WebP and TIFF
  std::uint64_t width = 0, height = 0;
  const char* format = "another format";  ///< "PNG", "JPEG", "BMP", "WebP" or "TIFF"
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

}  // namespace anigen::io
