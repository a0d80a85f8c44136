#include "anigen/core/error.h"
#include "anigen/tracking/video_file.h"

namespace anigen::tracking {

Video read_video_file(const std::filesystem::path& path) {
  throw NotSupportedError(path.string(), "",
                          "video files in a build without OpenCV; name a folder of pictures, such as ffmpeg -i FILE "
                          "FOLDER/%04d.png writes");
}

}  // namespace anigen::tracking
