#include "anigen/io/image_resize.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/byte_product.h"

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
  const int first = std::max(0, static_cast<int>(center - reach + 0.5));
  const int end = std::min(from, static_cast<int>(center + reach + 0.5));
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

Image along_rows(const Image& image, int width) {
  const std::vector<Tap> columns = taps(image.width, width);
  Image result(width, image.height);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < kImageChannels; ++c) {
        result.pixel(x, y)[c] = filtered(image.pixel(0, y) + c, kImageChannels, columns[static_cast<std::size_t>(x)]);
      }
    }
  }
  return result;
}

Image along_columns(const Image& image, int height) {
  const std::vector<Tap> rows = taps(image.height, height);
  const std::size_t stride = static_cast<std::size_t>(kImageChannels) * static_cast<std::size_t>(image.width);
  Image result(image.width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < kImageChannels; ++c) {
        result.pixel(x, y)[c] = filtered(image.pixel(x, 0) + c, stride, rows[static_cast<std::size_t>(y)]);
      }
    }
  }
  return result;
}

void premultiply(Image& image) {
  for (std::size_t i = 0; i < image.rgba.size(); i += kImageChannels) {
    std::uint8_t* p = image.rgba.data() + i;
    for (int c = 0; c < 3; ++c) p[c] = byte_product(p[c], p[3]);
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
  if (width != result.width) result = along_rows(result, width);
  if (height != result.height) result = along_columns(result, height);
  if (alpha == ResizeAlpha::kPremultiplied) unpremultiply(result);
  return result;
}

}  // namespace anigen::io
