#include "anigen/eval/image/picture_pair.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

bool sound(const io::Image& image) {
  return image.width > 0 && image.height > 0 &&
         image.rgba.size() == 4 * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
}

std::string size_of(const io::Image& image) {
  return std::to_string(image.width) + " × " + std::to_string(image.height);
}

}  // namespace

void check_pair(const io::Image& a, const io::Image& b) {
  if (!sound(a) || !sound(b)) throw InputError("", "image", "a picture is empty or incomplete");
  if (a.width != b.width || a.height != b.height) {
    throw InputError("", "image", "pictures of " + size_of(a) + " and " + size_of(b) + " pixels cannot be compared");
  }
}

}  // namespace anigen::eval
