#include "anigen/loaders/files/condition_crop.h"

#include <algorithm>
#include <cstring>

#include "anigen/core/error.h"

namespace anigen::loaders {

CropBox condition_crop(const io::Image& image, const std::string& file) {
  int left = image.width, top = image.height, right = -1, bottom = -1;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (image.pixel(x, y)[3] == 0) continue;
      left = std::min(left, x);
      right = std::max(right, x);
      top = std::min(top, y);
      bottom = y;
    }
  }
  if (right < 0) throw InputError(file, "alpha", "is 0 everywhere; the view shows no object");
  constexpr double kMargin = 1.2;
  const double x = 0.5 * (left + right), y = 0.5 * (top + bottom);
  const double half = 0.5 * std::max(right - left, bottom - top) * kMargin;
  const CropBox box{static_cast<int>(x - half), static_cast<int>(y - half), static_cast<int>(x + half),
                    static_cast<int>(y + half)};
  if (box.right <= box.left || box.bottom <= box.top) {
    throw InputError(file, "alpha", "the object covers a single pixel; there is nothing to crop");
  }
  return box;
}

io::Image crop(const io::Image& image, const CropBox& box) {
  io::Image part(box.right - box.left, box.bottom - box.top, 0);
  const int first = std::max(box.left, 0), last = std::min(box.right, image.width);
  for (int y = std::max(box.top, 0); y < std::min(box.bottom, image.height); ++y) {
    if (last <= first) break;
    std::memcpy(part.pixel(first - box.left, y - box.top), image.pixel(first, y),
                4 * static_cast<std::size_t>(last - first));
  }
  return part;
}

}  // namespace anigen::loaders
