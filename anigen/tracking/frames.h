#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/nn/torch.h"

namespace anigen::tracking {

using torch::Tensor;

inline constexpr std::size_t kMostFrames = 600;
inline constexpr int kMostFrameSide = 512;  ///< larger frames are reduced when they are read

/// A video as it came.
struct Video {
  std::vector<io::Image> frames;   ///< of one size
  std::vector<std::string> names;  ///< for messages
  double fps = 0.0;                ///< what the file says; 0: unknown, as for a folder of pictures
};

/// Reads the pictures of a folder by name, or, where OpenCV can, a video file (MP4, WebM, AVI, MOV, animated GIF;
/// tracking/video_file.h).
/// @param names of files of the folder, in order, or empty: all pictures in it
/// @throws InputError naming the file: none, unreadable, more than kMostFrames, frames of different size
Video read_video(const std::filesystem::path& path, const std::vector<std::string>& names = {});

/// A frame at one resolution, as the objective compares it: linear light squeezed by a square root, close to what the
/// eye and sRGB do.
struct FrameLevel {
  Tensor alpha;       ///< [S, S] fp64 coverage
  Tensor color;       ///< [S, S, 3] fp64: alpha · sqrt(linear colour)
  Tensor outside;     ///< [S, S] fp64: distance of a pixel's centre from the silhouette, in sides; 0 inside
  Tensor points;      ///< [Q, 2] fp64: places (u, v) spread over the silhouette
  double area = 0.0;  ///< Σ alpha, in pixels

  std::int64_t size() const { return alpha.size(0); }
};

/// The frame in the middle of a square, transparent beside it. @param image with alpha
io::Image squared(const io::Image& image);

/// @param image square @param size S, by averaging
/// @throws InputError naming the frame when nothing in it is visible
FrameLevel frame_level(const io::Image& image, std::int64_t size, const std::string& name);

}  // namespace anigen::tracking
