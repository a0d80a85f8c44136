#include "anigen/io/image_crop.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

constexpr std::int64_t kMostPixelsPerCropSide = 32768;
constexpr double kMargin = 1.2;
constexpr int kForeground = 204;  // 0.8 · 255

// Smallest and largest indices (both inclusive) of pixels with alpha above the limit.
std::optional<PixelBox> visible(const Image& image, int alpha_above) {
  PixelBox box{image.width, image.height, -1, -1};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (image.pixel(x, y)[3] <= alpha_above) continue;
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x), std::max(box.y1, y)};
    }
  }
  if (box.x1 < 0) return std::nullopt;
  return box;
}

PixelBox around(const PixelBox& seen, double half) {
  const double x = (seen.x0 + seen.x1) / 2.0, y = (seen.y0 + seen.y1) / 2.0;
  return {static_cast<int>(x - half), static_cast<int>(y - half), static_cast<int>(x + half),
          static_cast<int>(y + half)};
}

int extent(const PixelBox& seen) { return std::max(seen.x1 - seen.x0, seen.y1 - seen.y0); }

PixelBox checked(const PixelBox& box, const std::string& name) {
  if (box.x1 > box.x0 && box.y1 > box.y0) return box;
  throw InputError(name, "", "the object covers a single pixel of the picture: nothing to crop to");
}

}  // namespace

Image crop(const Image& image, const PixelBox& box) {
  const std::int64_t width = static_cast<std::int64_t>(box.x1) - box.x0;
  const std::int64_t height = static_cast<std::int64_t>(box.y1) - box.y0;
  if (width < 1 || height < 1 || width > kMostPixelsPerCropSide || height > kMostPixelsPerCropSide) {
    throw InputError("", "", "a crop of " + std::to_string(width) + " x " + std::to_string(height) + " pixels");
  }
  Image result(static_cast<int>(width), static_cast<int>(height), 0);
  const int left = std::max(box.x0, 0), right = std::min(box.x1, image.width);
  if (left >= right) return result;
  for (int y = std::max(box.y0, 0); y < std::min(box.y1, image.height); ++y) {
    std::memcpy(result.pixel(left - box.x0, y - box.y0), image.pixel(left, y),
                static_cast<std::size_t>(right - left) * kImageChannels);
  }
  return result;
}

PixelBox condition_box(const Image& image, const std::string& name) {
  const std::optional<PixelBox> seen = visible(image, 0);
  if (!seen) throw InputError(name, "", "no pixel is visible: alpha is 0 everywhere");
  return checked(around(*seen, extent(*seen) / 2.0 * kMargin), name);
}

PixelBox inference_box(const Image& image, const std::string& name) {
  const std::optional<PixelBox> seen = visible(image, kForeground);
  if (!seen) return {0, 0, image.width, image.height};
  const int side = static_cast<int>(extent(*seen) * kMargin);
  return checked(around(*seen, side / 2), name);
}

}  // namespace anigen::io
