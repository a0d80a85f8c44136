#pragma once
#include <filesystem>

#include "anigen/tracking/frames.h"

namespace anigen::tracking {

/// Decodes a video file by OpenCV and FFmpeg, in a process without rights.
/// @throws InputError naming the file: no video, damaged, more than kMostFrames, frames of different size;
/// NotSupportedError in a build without OpenCV
Video read_video_file(const std::filesystem::path& path);

}  // namespace anigen::tracking
