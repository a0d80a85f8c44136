#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/guarded_reader.h"
#include "anigen/core/process.h"
#include "anigen/tracking/frame_collector.h"
#include "anigen/tracking/video_file.h"

namespace anigen::tracking {

namespace {

namespace fs = std::filesystem;

/// Of the process that decodes a video file: what 600 large frames take.
constexpr double kVideoSeconds = 900.0;
constexpr std::uint64_t kVideoMemory = std::uint64_t{8} << 30;

io::Image image_of(const cv::Mat& bgr) {
  cv::Mat rgba;
  cv::cvtColor(bgr, rgba,
               bgr.channels() == 4   ? cv::COLOR_BGRA2RGBA
               : bgr.channels() == 1 ? cv::COLOR_GRAY2RGBA
                                     : cv::COLOR_BGR2RGBA);
  io::Image image(rgba.cols, rgba.rows);
  for (int y = 0; y < rgba.rows; ++y) std::copy_n(rgba.ptr<std::uint8_t>(y), 4 * rgba.cols, image.pixel(0, y));
  return image;
}

std::string frame_name(const fs::path& path, std::size_t frame) {
  return path.string() + ", frame " + std::to_string(frame);
}

Video decoded_video(const fs::path& path) {
  FrameCollector collector;
  Video& video = collector.video;
  try {
    cv::VideoCapture capture;
    capture.setExceptionMode(false);
    if (!capture.open(path.string(), cv::CAP_FFMPEG)) {
      throw InputError(path.string(), "",
                       "is no video that OpenCV reads here; name a folder of pictures, such as ffmpeg -i FILE "
                       "FOLDER/%04d.png writes");
    }
    const double fps = capture.get(cv::CAP_PROP_FPS);
    if (std::isfinite(fps) && fps >= 1.0 && fps <= 240.0) video.fps = fps;
    cv::Mat frame;
    while (capture.read(frame)) {
      if (frame.empty() || frame.depth() != CV_8U)
        throw InputError(path.string(), "frame " + std::to_string(video.frames.size()), "has pixels of another depth");
      if (frame.cols > io::kMostPixelsPerSide || frame.rows > io::kMostPixelsPerSide)
        throw InputError(path.string(), "", "its frames are too large");
      collector.add(image_of(frame), frame_name(path, video.frames.size()));
      refuse_frame_count(video.frames.size(), path);
    }
  } catch (const cv::Exception& error) {
    throw InputError(path.string(), "", "OpenCV cannot read it: " + std::string(error.err));
  }
  if (video.frames.empty()) throw InputError(path.string(), "", "holds no frame");
  return std::move(video);
}

/// Begins the answer of the process that decodes; the frames' pixels follow it.
struct VideoHead {
  double fps = 0.0;
  int width = 0, height = 0;
};

}  // namespace

// FFmpeg, with its hundreds of formats, runs in a process without rights.
Video read_video_file(const fs::path& path) {
  ProcessLimits limits;
  limits.cpu_seconds = kVideoSeconds;
  limits.more_memory = kVideoMemory;
  limits.sandbox = SandboxRights{};
  limits.while_waiting = throw_if_interrupted;
  const std::string answer = read_guarded(
      path.string(), "cannot be read as a video: the decoder %; the file is damaged or hostile", limits, [&path] {
        const Video video = decoded_video(path);
        const io::Image& first = video.frames.front();
        const VideoHead head{video.fps, first.width, first.height};
        std::string bytes(reinterpret_cast<const char*>(&head), sizeof head);
        bytes.reserve(sizeof head + video.frames.size() * first.rgba.size());
        for (const io::Image& frame : video.frames) bytes.append(frame.rgba.begin(), frame.rgba.end());
        return bytes;
      });
  VideoHead head;
  std::memcpy(&head, answer.data(), std::min(sizeof head, answer.size()));
  const auto fits = [](int side) { return side > 0 && side <= kMostFrameSide; };
  const std::size_t frame_bytes =
      fits(head.width) && fits(head.height)
          ? std::size_t{4} * static_cast<std::size_t>(head.width) * static_cast<std::size_t>(head.height)
          : 0;
  // A decoder that the file has taken over may answer anything.
  if (frame_bytes == 0 || answer.size() <= sizeof head || (answer.size() - sizeof head) % frame_bytes != 0 ||
      (answer.size() - sizeof head) / frame_bytes > kMostFrames || !std::isfinite(head.fps))
    throw InputError(path.string(), "", "cannot be read as a video: the decoder gave no frames");
  Video video;
  video.fps = head.fps;
  const io::Image blank(head.width, head.height);
  for (std::size_t at = sizeof head; at < answer.size(); at += frame_bytes) {
    video.names.push_back(frame_name(path, video.frames.size()));
    video.frames.push_back(blank);
    std::memcpy(video.frames.back().rgba.data(), answer.data() + at, frame_bytes);
  }
  return video;
}

}  // namespace anigen::tracking
