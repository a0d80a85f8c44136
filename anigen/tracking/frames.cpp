#include "anigen/tracking/frames.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/guarded_reader.h"
#include "anigen/core/process.h"
#include "anigen/io/foreign_image.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/scene.h"

namespace anigen::tracking {

namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kSilhouettePoints = 300;

constexpr std::uintmax_t kMostPictureBytes = std::uintmax_t{1} << 30;

/// Of the process that decodes a video file: what 600 large frames take.
constexpr double kVideoSeconds = 900.0;
constexpr std::uint64_t kVideoMemory = std::uint64_t{8} << 30;

std::string size_text(const io::Image& image) {
  return std::to_string(image.width) + " x " + std::to_string(image.height);
}

io::Image limited(io::Image image) {
  const int longest = std::max(image.width, image.height);
  if (longest <= kMostFrameSide) return image;
  const auto side = [&](int length) {
    return std::max(1, static_cast<int>(static_cast<std::int64_t>(length) * kMostFrameSide / longest));
  };
  return io::resize_lanczos(image, side(image.width), side(image.height), io::ResizeAlpha::kPremultiplied);
}

void refuse_count(std::size_t count, const fs::path& path) {
  if (count <= kMostFrames) return;
  throw InputError(
      path.string(), "",
      "more than " + std::to_string(kMostFrames) + " frames; cut the video or leave out every second frame");
}

/// Takes frames one by one and keeps them alike.
void append_frame(Video& video, io::Image image, const std::string& name, io::Image& first) {
  if (image.width < 8 || image.height < 8)
    throw InputError(name, "", size_text(image) + " pixels are too few to show anything: each side needs 8");
  if (video.frames.empty()) first = io::Image(image.width, image.height, 0);
  if (image.width != first.width || image.height != first.height) {
    throw InputError(name, "",
                     "is of " + size_text(image) + " pixels, " + video.names.front() + " of " + size_text(first) +
                         ": frames of one video have one size");
  }
  video.frames.push_back(limited(std::move(image)));
  video.names.push_back(name);
}

Video read_folder(const fs::path& folder, const std::vector<std::string>& names) {
  std::vector<fs::path> files;
  if (names.empty()) files = io::picture_files(folder);
  for (const std::string& name : names) files.push_back(folder / name);
  refuse_count(files.size(), folder);
  Video video;
  io::Image first;
  for (const fs::path& file : files) {
    throw_if_interrupted();
    const std::string bytes = anigen::read_file(file, kMostPictureBytes);
    append_frame(video, io::decode_foreign_image({bytes.begin(), bytes.end()}, file.string()), file.string(), first);
  }
  return video;
}

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
  Video video;
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
    io::Image first;
    while (capture.read(frame)) {
      if (frame.empty() || frame.depth() != CV_8U)
        throw InputError(path.string(), "frame " + std::to_string(video.frames.size()), "has pixels of another depth");
      if (frame.cols > io::kMostPixelsPerSide || frame.rows > io::kMostPixelsPerSide)
        throw InputError(path.string(), "", "its frames are too large");
      append_frame(video, image_of(frame), frame_name(path, video.frames.size()), first);
      refuse_count(video.frames.size(), path);
    }
  } catch (const cv::Exception& error) {
    throw InputError(path.string(), "", "OpenCV cannot read it: " + std::string(error.err));
  }
  if (video.frames.empty()) throw InputError(path.string(), "", "holds no frame");
  return video;
}

/// Begins the answer of the process that decodes; the frames' pixels follow it.
struct VideoHead {
  double fps = 0.0;
  int width = 0, height = 0;
};

/// FFmpeg, with its hundreds of formats, runs in a process without rights.
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

/// Mean of a picture's pixels over the pixels of a coarser or finer one.
Tensor averaged(const Tensor& image, std::int64_t size) {  // [H, W, C] → [S, S, C]
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(0).contiguous();
  return at::adaptive_avg_pool2d(planes, {size, size}).squeeze(0).permute({1, 2, 0}).contiguous();
}

/// Distance of every pixel's centre from the nearest silhouette pixel's, in sides of the picture (Felzenszwalb and
/// Huttenlocher's exact transform, OpenCV). It does not change inside.
Tensor distance_outside(const Tensor& alpha) {
  const auto size = static_cast<int>(alpha.size(0));
  cv::Mat background(size, size, CV_8U), distance;
  const double* coverage = alpha.data_ptr<double>();
  for (int i = 0; i < size * size; ++i) background.data[i] = coverage[i] >= 0.5 ? 0 : 255;
  cv::distanceTransform(background, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE, CV_32F);
  const Tensor result = torch::empty({size, size}, torch::kFloat64);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x)
      result.data_ptr<double>()[y * size + x] = static_cast<double>(distance.at<float>(y, x)) / size;
  }
  return result;
}

}  // namespace

Video read_video(const fs::path& path, const std::vector<std::string>& names) {
  std::error_code error;
  if (!fs::exists(path, error)) throw InputError(path.string(), "", "there is no such folder or file");
  return fs::is_directory(path, error) ? read_folder(path, names) : read_video_file(path);
}

io::Image squared(const io::Image& image) {
  if (image.width == image.height) return image;
  const int side = std::max(image.width, image.height);
  io::PixelBox box;
  box.x0 = (image.width - side) / 2;
  box.y0 = (image.height - side) / 2;
  box.x1 = box.x0 + side;
  box.y1 = box.y0 + side;
  return io::crop(image, box);
}

FrameLevel frame_level(const io::Image& image, std::int64_t size, const std::string& name) {
  if (image.width != image.height) throw InputError(name, "", size_text(image) + " pixels are no square");
  const Tensor premultiplied = torch::empty({image.height, image.width, 4}, torch::kFloat64);
  double* to = premultiplied.data_ptr<double>();
  for (std::size_t i = 0; i < image.rgba.size(); i += io::kImageChannels) {
    const double alpha = image.rgba[i + 3] / 255.0;
    for (std::size_t c = 0; c < 3; ++c)
      *to++ = alpha * static_cast<double>(render::srgb_to_linear(static_cast<float>(image.rgba[i + c]) / 255.0f));
    *to++ = alpha;
  }
  const Tensor reduced = averaged(premultiplied, size);
  FrameLevel level;
  level.alpha = reduced.select(2, 3).contiguous();
  // alpha · sqrt(c / alpha) of the premultiplied c.
  level.color = (reduced.narrow(2, 0, 3) * reduced.narrow(2, 3, 1)).clamp_min(0.0).sqrt();
  level.area = level.alpha.sum().item<double>();
  const Tensor inside = (level.alpha >= 0.5).flatten().nonzero().flatten();
  if (inside.numel() == 0) throw InputError(name, "", "nothing in it is visible: there is no object to follow");
  level.outside = distance_outside(level.alpha);
  const std::int64_t taken = std::min(kSilhouettePoints, inside.numel());
  const Tensor kept = inside.index_select(
      0, (torch::arange(taken, torch::kFloat64) * static_cast<double>(inside.numel()) / static_cast<double>(taken))
             .to(torch::kInt64));
  const Tensor row = torch::floor_divide(kept, size), column = kept - row * size;
  level.points = (torch::stack({column, row}, 1).to(torch::kFloat64) + 0.5) / static_cast<double>(size);
  return level;
}

}  // namespace anigen::tracking
