#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace anigen::io {

struct PictureSize {
  bool known = false;  ///< false for formats other than PNG, JPEG, BMP, WebP and TIFF
  std::uint64_t width = 0, height = 0;
};

/// Size in pixels from the header alone, so that a hostile one is refused before anything is allocated; also notices
/// PNG and JPEG files that end too early, which decoders may fill with grey.
/// @throws InputError when the header is cut short or the file is truncated
PictureSize probe_picture(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors);

}  // namespace anigen::io
