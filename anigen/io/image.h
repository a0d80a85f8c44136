#pragma once
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

/// PNG, JPEG or what OpenCV reads. @throws InputError when it cannot be decoded or exceeds 16,384 pixels on a side
Image decode_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors);
Image read_image(const std::filesystem::path& path);
std::vector<std::uint8_t> encode_png(const Image& image);
/// Over white where the picture is transparent. @param quality 1 … 100
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);
void write_png(const std::filesystem::path& path, const Image& image);  ///< atomic

}  // namespace anigen::io
