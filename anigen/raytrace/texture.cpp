#include "anigen/raytrace/texture.h"

#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/raytrace/srgb.h"

namespace anigen::raytrace {
namespace {

const std::array<float, 256>& linear_table() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = srgb_to_linear(static_cast<float>(i) / 255.0f);
    return values;
  }();
  return table;
}

/// Texel coordinate in [0, size) and the fraction towards the next texel.
struct Tap {
  int first, second;
  float fraction;
};

Tap tap(float coordinate, int size) {
  // Reducing first keeps precision and makes any finite coordinate safe.
  const float repeated = coordinate - std::floor(coordinate);
  const float position = repeated * static_cast<float>(size) - 0.5f;
  const float low = std::floor(position);
  const int first = (static_cast<int>(low) + size) % size;
  return {first, (first + 1) % size, position - low};
}

}  // namespace

Texture::Texture(const EncodedImage& image, const std::string& name_for_errors)
    : image_(io::decode_image(image.bytes, name_for_errors)) {
  if (image_.width < 1 || image_.height < 1) throw InputError(name_for_errors, "", "the picture has no pixels");
  for (std::size_t i = 3; i < image_.rgba.size() && opaque_; i += 4) opaque_ = image_.rgba[i] == 255;
}

Eigen::Vector3f Texture::lookup(const Eigen::Vector2f& uv) const {
  const Tap x = tap(uv.x(), image_.width), y = tap(uv.y(), image_.height);
  const std::array<float, 256>& linear = linear_table();
  const auto texel = [&](int column, int row) {
    const std::uint8_t* p = image_.pixel(column, row);
    return Eigen::Vector3f(linear[p[0]], linear[p[1]], linear[p[2]]);
  };
  const Eigen::Vector3f top = (1.0f - x.fraction) * texel(x.first, y.first) + x.fraction * texel(x.second, y.first);
  const Eigen::Vector3f bottom =
      (1.0f - x.fraction) * texel(x.first, y.second) + x.fraction * texel(x.second, y.second);
  return (1.0f - y.fraction) * top + y.fraction * bottom;
}

float Texture::alpha(const Eigen::Vector2f& uv) const {
  if (opaque_) return 1.0f;
  const Tap x = tap(uv.x(), image_.width), y = tap(uv.y(), image_.height);
  const auto texel = [&](int column, int row) { return static_cast<float>(image_.pixel(column, row)[3]) / 255.0f; };
  const float top = (1.0f - x.fraction) * texel(x.first, y.first) + x.fraction * texel(x.second, y.first);
  const float bottom = (1.0f - x.fraction) * texel(x.first, y.second) + x.fraction * texel(x.second, y.second);
  return (1.0f - y.fraction) * top + y.fraction * bottom;
}

}  // namespace anigen::raytrace
