#pragma once
#include <filesystem>
#include <string>

#include "anigen/engine/animate.h"
#include "anigen/motions/animate_files.h"

namespace anigen {

/// The command line of anigen-animate.
struct AnimateArguments {
  engine::AnimateOptions clips;
  motions::AnimateRequest request;  ///< what the library has no option for
  std::string asset, pose, pictures;
  std::string video, background = "auto";
  std::filesystem::path matting_network;
  double video_fps = 0.0;  ///< 0: the video's own
  bool list = false, drop_clips = false;
};

}  // namespace anigen
