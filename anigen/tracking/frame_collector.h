#pragma once
#include <cstddef>
#include <filesystem>
#include <string>

#include "anigen/io/image.h"
#include "anigen/tracking/frames.h"

namespace anigen::tracking {

/// "20 x 10"
std::string size_text(const io::Image& image);

/// @throws InputError naming the path for more than kMostFrames
void refuse_frame_count(std::size_t count, const std::filesystem::path& path);

/// Takes the frames of a video one by one, keeps them alike and reduces the large ones to kMostFrameSide.
class FrameCollector {
 public:
  /// @param name for messages @throws InputError naming the frame: a side below 8 pixels, or another size than the
  /// first
  void add(io::Image image, const std::string& name);

  Video video;

 private:
  int width_ = 0, height_ = 0;  // of the first frame as it came
};

}  // namespace anigen::tracking
