#include "anigen/core/error.h"
#include "anigen/generate/grabcut.h"

namespace anigen::generate {

bool has_grabcut() { return false; }

std::vector<std::uint8_t> grabcut_mask(const io::Image&) {
  throw NotSupportedError("", "background",
                          "GrabCut in a build without OpenCV; give a picture with transparency, a mask, or the shipped "
                          "matting network");
}

}  // namespace anigen::generate
