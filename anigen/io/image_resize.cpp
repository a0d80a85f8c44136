#include "anigen/io/image_resize.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::io {

namespace {

constexpr double kSupport = 3.0;  // lobes of the Lanczos window
constexpr int kFractionBits = 22;

double sinc(double x) {
  if (x == 0.0) return 1.0;
  x *= kPi;
  return std::sin(x) / x;
}

double lanczos(double x) { return x >= -kSupport && x < kSupport ? sinc(x) * sinc(x / kSupport) : 0.0; }

// The source samples that one destination sample is the weighted sum of.
struct Tap {
  int first = 0;
  std::vector<std::int32_t> weights;  // fixed point
};

std::int32_t fixed_point(double weight) {
  return static_cast<std::int32_t>(weight * (1 << kFractionBits) + (weight < 0.0 ? -0.5 : 0.5));
}

Tap tap_at(int at, int from, double scale) {
  const double widening = std::max(scale, 1.0);
  const double center = (at + 0.5) * scale, reach = kSupport * widening;
  const int first = std::max(0, static_cast<int>(std::floor(center - reach + 0.5)));
  const int end = std::min(from, static_cast<int>(std::floor(center + reach + 0.5)));
  std::vector<double> weights;
  double sum = 0.0;
  for (int i = first; i < end; ++i) {
    weights.push_back(lanczos((i - center + 0.5) * (1.0 / widening)));
    sum += weights.back();
  }
  Tap tap;
  tap.first = first;
  for (const double weight : weights) tap.weights.push_back(fixed_point(sum != 0.0 ? weight / sum : weight));
  return tap;
}

std::vector<Tap> taps(int from, int to) {
  const double scale = static_cast<double>(from) / to;
  std::vector<Tap> list;
  for (int i = 0; i < to; ++i) list.push_back(tap_at(i, from, scale));
  return list;
}

// One sample of one channel; `stride` bytes lie between neighbours along the filtered axis.
std::uint8_t filtered(const std::uint8_t* line, std::size_t stride, const Tap& tap) {
  std::int32_t sum = 1 << (kFractionBits - 1);
  const std::uint8_t* sample = line + static_cast<std::size_t>(tap.first) * stride;
  for (const std::int32_t weight : tap.weights) {
    sum += *sample * weight;
    sample += stride;
  }
  return static_cast<std::uint8_t>(std::clamp(sum >> kFractionBits, 0, 255));
}

// One pass: the rows, or the columns, made `size` long.
Image along(const Image& image, bool rows, int size) {
  const std::vector<Tap> list = taps(rows ? image.width : image.height, size);
  Image result(rows ? size : image.width, rows ? image.height : size);
  const std::size_t stride =
      static_cast<std::size_t>(kImageChannels) * static_cast<std::size_t>(rows ? 1 : image.width);
  for (int y = 0; y < result.height; ++y) {
    for (int x = 0; x < result.width; ++x) {
      const std::uint8_t* line = rows ? image.pixel(0, y) : image.pixel(x, 0);
      const Tap& tap = list[static_cast<std::size_t>(rows ? x : y)];
      for (int c = 0; c < kImageChannels; ++c) result.pixel(x, y)[c] = filtered(line + c, stride, tap);
    }
  }
  return result;
}

void premultiply(Image& image) {
  for (std::size_t i = 0; i < image.rgba.size(); i += kImageChannels) {
    std::uint8_t* p = image.rgba.data() + i;
    for (int c = 0; c < 3; ++c) p[c] = anigen::byte_product(p[c], p[3]);
  }
}

void unpremultiply(Image& image) {
  for (std::size_t i = 0; i < image.rgba.size(); i += kImageChannels) {
    std::uint8_t* p = image.rgba.data() + i;
    if (p[3] == 0 || p[3] == 255) continue;
    for (int c = 0; c < 3; ++c) p[c] = static_cast<std::uint8_t>(std::min(255, 255 * p[c] / p[3]));
  }
}

}  // namespace

Image resize_lanczos(const Image& image, int width, int height, ResizeAlpha alpha) {
  if (image.width < 1 || image.height < 1) throw InputError("", "", "a picture without pixels cannot be resized");
  if (width < 1 || height < 1 || width > kMostPixelsPerSide || height > kMostPixelsPerSide) {
    throw InputError("", "",
                     "a picture cannot be resized to " + std::to_string(width) + " x " + std::to_string(height) +
                         " pixels; each side must lie in 1 … " + std::to_string(kMostPixelsPerSide));
  }
  if (image.width == width && image.height == height) return image;
  Image result = image;
  if (alpha == ResizeAlpha::kPremultiplied) premultiply(result);
  if (width != result.width) result = along(result, true, width);
  if (height != result.height) result = along(result, false, height);
  if (alpha == ResizeAlpha::kPremultiplied) unpremultiply(result);
  return result;
}

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
  if (width < 1 || height < 1 || width > kMostPixelsPerCropSide || height > kMostPixelsPerCropSide)
    throw InputError("", "", "a crop of " + std::to_string(width) + " x " + std::to_string(height) + " pixels");
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

namespace {

constexpr std::size_t kColors = 3, kAlphaChannel = 3;

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
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = unit(image.rgba[kImageChannels * i + kAlphaChannel]);
  return plane;
}

std::vector<float> premultiplied_planes(const Image& image) {
  std::vector<float> planes = color_planes(image);
  const std::vector<float> alpha = alpha_plane(image);
  for (std::size_t i = 0; i < planes.size(); ++i) planes[i] *= alpha[i % alpha.size()];
  return planes;
}

Image composed_on_black(const Image& image) {
  Image result = image;
  for (std::size_t i = 0; i < result.rgba.size(); i += kImageChannels) {
    std::uint8_t* p = result.rgba.data() + i;
    for (std::size_t c = 0; c < kColors; ++c)
      p[c] = static_cast<std::uint8_t>(unit(p[c]) * unit(p[kAlphaChannel]) * 255.0f);
    p[kAlphaChannel] = 255;
  }
  return result;
}

}  // namespace anigen::io
