#include "anigen/io/image_planes.h"

#include <cstddef>

namespace anigen::io {
namespace {

constexpr std::size_t kColors = 3, kAlpha = 3;

float unit(std::uint8_t byte) { return static_cast<float>(byte) / 255.0f; }

std::size_t pixels(const Image& image) { return image.rgba.size() / kImageChannels; }

}  // namespace

std::vector<float> color_planes(const Image& image) {
  const std::size_t count = pixels(image);
  std::vector<float> planes(kColors * count);
  for (std::size_t c = 0; c < kColors; ++c) {
    for (std::size_t i = 0; i < count; ++i) planes[c * count + i] = unit(image.rgba[kImageChannels * i + c]);
  }
  return planes;
}

std::vector<float> alpha_plane(const Image& image) {
  std::vector<float> plane(pixels(image));
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = unit(image.rgba[kImageChannels * i + kAlpha]);
  return plane;
}

std::vector<float> premultiplied_planes(const Image& image) {
  const std::size_t count = pixels(image);
  std::vector<float> planes = color_planes(image);
  for (std::size_t c = 0; c < kColors; ++c) {
    for (std::size_t i = 0; i < count; ++i) planes[c * count + i] *= unit(image.rgba[kImageChannels * i + kAlpha]);
  }
  return planes;
}

Image composed_on_black(const Image& image) {
  Image result = image;
  for (std::size_t i = 0; i < result.rgba.size(); i += kImageChannels) {
    std::uint8_t* p = result.rgba.data() + i;
    for (std::size_t c = 0; c < kColors; ++c) p[c] = static_cast<std::uint8_t>(unit(p[c]) * unit(p[kAlpha]) * 255.0f);
    p[kAlpha] = 255;
  }
  return result;
}

}  // namespace anigen::io
