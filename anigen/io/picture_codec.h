#pragma once
#include <cstdint>
#include <string_view>
#include <vector>

#include "anigen/io/image.h"

// Decoders and encoders of picture files behind io/image.h: OpenCV's, and stb's with zlib, which lean builds use.

namespace anigen::io {

namespace opencv_codec {

/// True for a format as PictureSize names it.
bool reads(std::string_view format);
/// The picture as stored: no turning by EXIF orientation. @return false for damaged files
/// @throws NotSupportedError without a file name for pixels that are neither 8, 16 nor 32 bits wide
bool decode(const std::vector<std::uint8_t>& bytes, Image& image, StoredPixels& stored);
/// @param grey only set where the file holds one channel of 16 bits @return false for damaged files
bool decode_grey16(const std::vector<std::uint8_t>& bytes, Grey16& grey, StoredPixels& stored);
std::vector<std::uint8_t> encode_png(const Image& image);
std::vector<std::uint8_t> encode_png16(const Grey16& grey);
/// Alpha is ignored.
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);

}  // namespace opencv_codec

/// PNG, JPEG and BMP by stb_image, whose decoders check less than OpenCV's: foreign pictures are decoded in a process
/// without rights (io/foreign_image.h). PNG is written by zlib, JPEG by stb_image_write.
namespace stb_codec {

bool reads(std::string_view format);
bool decode(const std::vector<std::uint8_t>& bytes, Image& image, StoredPixels& stored);
bool decode_grey16(const std::vector<std::uint8_t>& bytes, Grey16& grey, StoredPixels& stored);
std::vector<std::uint8_t> encode_png(const Image& image);
std::vector<std::uint8_t> encode_png16(const Grey16& grey);
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);

}  // namespace stb_codec

#ifdef ANIGEN_LEAN
namespace picture_codec = stb_codec;
#else
namespace picture_codec = opencv_codec;
#endif

}  // namespace anigen::io
