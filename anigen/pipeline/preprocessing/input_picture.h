#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "anigen/io/image.h"

namespace anigen::pipeline {

inline constexpr int kLeastPictureSide = 8;
/// Bounds the memory of preprocessing, whose largest part is the crop of a picture that fills its frame.
inline constexpr std::int64_t kMostPicturePixels = 100'000'000;

/// A picture that somebody hands in.
struct InputPicture {
  io::Image image;
  std::string name;     ///< for messages
  bool turned = false;  ///< by its EXIF orientation
};

/// A PNG, JPEG (CMYK too), WebP, BMP or TIFF of any depth, as 8-bit RGBA: grey becomes three equal channels, 16 bit are
/// rounded to 8, palettes are resolved with their alpha. Turned upright as EXIF says, unlike the published pipeline,
/// where the background remover honours EXIF and the normal map does not (reference flows-and-pipeline.md, 5.2).
/// Colour profiles are not applied.
/// @throws InputError when it cannot be read, or check_input_picture refuses it
InputPicture read_input_picture(const std::filesystem::path& path);

/// @throws InputError for a picture with a side below kLeastPictureSide or above io::kMostPixelsPerSide, with more than
/// kMostPicturePixels, or in which every pixel is fully transparent
void check_input_picture(const io::Image& image, const std::string& name);

}  // namespace anigen::pipeline
