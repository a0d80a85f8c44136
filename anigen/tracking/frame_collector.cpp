#include "anigen/tracking/frame_collector.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/image_resize.h"

namespace anigen::tracking {

namespace {

constexpr int kLeastFrameSide = 8;

std::string size_text(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

io::Image limited(io::Image image) {
  const int longest = std::max(image.width, image.height);
  if (longest <= kMostFrameSide) return image;
  const auto side = [&](int length) {
    return std::max(1, static_cast<int>(static_cast<std::int64_t>(length) * kMostFrameSide / longest));
  };
  return io::resize_lanczos(image, side(image.width), side(image.height), io::ResizeAlpha::kPremultiplied);
}

}  // namespace

std::string size_text(const io::Image& image) { return size_text(image.width, image.height); }

void refuse_frame_count(std::size_t count, const std::filesystem::path& path) {
  if (count <= kMostFrames) return;
  throw InputError(
      path.string(), "",
      "more than " + std::to_string(kMostFrames) + " frames; cut the video or leave out every second frame");
}

void FrameCollector::add(io::Image image, const std::string& name) {
  if (image.width < kLeastFrameSide || image.height < kLeastFrameSide)
    throw InputError(name, "", size_text(image) + " pixels are too few to show anything: each side needs 8");
  if (video.frames.empty()) {
    width_ = image.width;
    height_ = image.height;
  }
  if (image.width != width_ || image.height != height_) {
    throw InputError(name, "",
                     "is of " + size_text(image) + " pixels, " + video.names.front() + " of " +
                         size_text(width_, height_) + ": frames of one video have one size");
  }
  video.frames.push_back(limited(std::move(image)));
  video.names.push_back(name);
}

}  // namespace anigen::tracking
