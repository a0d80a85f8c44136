#pragma once
#include <cstdint>
#include <string_view>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::io {

/// Decoders and encoders of picture files behind io/image.h.
struct PictureCodec {
  enum class Outcome {
    kDone,
    kDamaged,
    kOtherPixels  ///< neither 8, 16 nor 32 bits, or more than four channels
  };
  /// True for a format as PictureSize names it.
  bool (*reads)(std::string_view format);
  /// The picture as stored: no turning by EXIF orientation.
  Outcome (*decode)(const std::vector<std::uint8_t>& bytes, Image& image, StoredPixels& stored);
  /// Values are filled in only where the file holds one channel of 16 bits.
  Outcome (*decode_grey16)(const std::vector<std::uint8_t>& bytes, Grey16& grey, StoredPixels& stored);
  /// Encoders return nothing where they fail.
  std::vector<std::uint8_t> (*encode_png)(const Image& image);
  std::vector<std::uint8_t> (*encode_png16)(const Grey16& grey);
  std::vector<std::uint8_t> (*encode_jpeg)(const Image& image, int quality);  ///< alpha is ignored
};

/// PNG, JPEG and BMP by stb_image, whose decoders check less than OpenCV's: foreign pictures are decoded in a process
/// without rights (io/foreign_image.h). PNG is written by zlib, JPEG by stb_image_write.
const PictureCodec& stb_codec();

/// WebP and TIFF, too, by OpenCV. @return null where its module is not there (io/opencv_module.h)
const PictureCodec* opencv_codec();

/// OpenCV's codec where it is there, else stb's. The first call loads it.
const PictureCodec& picture_codec();

}  // namespace anigen::io
