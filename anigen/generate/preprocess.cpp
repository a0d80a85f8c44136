#include "anigen/generate/preprocess.h"

#include <algorithm>

#include "anigen/core/numeric.h"
#include "anigen/io/image_resize.h"

namespace anigen::generate {

namespace {

void require_bytes(std::size_t found, std::size_t wanted) {
  if (found != wanted) throw InputError("", "mask", "a mask and its picture differ in size");
}

}  // namespace

Background parse_background(const std::string& word) { return chosen("background", word, kBackgroundWords); }

io::Image without_alpha(const io::Image& image) {
  io::Image opaque = image;
  for (std::size_t i = 3; i < opaque.rgba.size(); i += io::kImageChannels) opaque.rgba[i] = 255;
  return opaque;
}

io::Image cut_out(const io::Image& image, const std::vector<std::uint8_t>& mask) {
  require_bytes(io::kImageChannels * mask.size(), image.rgba.size());
  io::Image result = image;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    std::uint8_t* pixel = result.rgba.data() + io::kImageChannels * i;
    for (int c = 0; c < 3; ++c) pixel[c] = byte_product(pixel[c], mask[i]);
    pixel[3] = mask[i];
  }
  return result;
}

io::Image with_alpha_of(const io::Image& colors, const io::Image& alpha) {
  require_bytes(colors.rgba.size(), alpha.rgba.size());
  io::Image result = colors;
  for (std::size_t i = 3; i < result.rgba.size(); i += io::kImageChannels) result.rgba[i] = alpha.rgba[i];
  return result;
}

io::Image reduced(const io::Image& image, int longest) {
  const int longer = std::max(image.width, image.height);
  if (longer <= longest) return image;
  const double scale = static_cast<double>(longest) / longer;
  const auto side = [scale](int length) { return std::max(1, static_cast<int>(length * scale)); };
  return io::resize_lanczos(image, side(image.width), side(image.height), io::ResizeAlpha::kSeparate);
}

}  // namespace anigen::generate
