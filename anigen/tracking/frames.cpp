#include "anigen/tracking/frames.h"

#include <algorithm>
#include <cmath>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/io/foreign_image.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/scene.h"
#include "anigen/tracking/distance_transform.h"
#include "anigen/tracking/frame_collector.h"
#include "anigen/tracking/video_file.h"

namespace anigen::tracking {

namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kSilhouettePoints = 300;

constexpr std::uintmax_t kMostPictureBytes = std::uintmax_t{1} << 30;

Video read_folder(const fs::path& folder, const std::vector<std::string>& names) {
  std::vector<fs::path> files;
  if (names.empty()) files = io::picture_files(folder);
  for (const std::string& name : names) files.push_back(folder / name);
  refuse_frame_count(files.size(), folder);
  FrameCollector collector;
  for (const fs::path& file : files) {
    throw_if_interrupted();
    const std::string bytes = anigen::read_file(file, kMostPictureBytes);
    collector.add(io::decode_foreign_image({bytes.begin(), bytes.end()}, file.string()), file.string());
  }
  return std::move(collector.video);
}

/// Mean of a picture's pixels over the pixels of a coarser or finer one.
Tensor averaged(const Tensor& image, std::int64_t size) {  // [H, W, C] → [S, S, C]
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(0).contiguous();
  return at::adaptive_avg_pool2d(planes, {size, size}).squeeze(0).permute({1, 2, 0}).contiguous();
}

/// Distance of every pixel's centre from the nearest silhouette pixel's, in sides of the picture; 0 inside.
Tensor distance_outside(const Tensor& alpha) {
  const std::int64_t size = alpha.size(0);
  const Tensor inside = (alpha >= 0.5).to(torch::kUInt8).contiguous();
  const std::uint8_t* marked = inside.data_ptr<std::uint8_t>();
  const std::vector<double> distances =
      distance_transform({marked, marked + inside.numel()}, static_cast<int>(size), static_cast<int>(size));
  const Tensor result = torch::empty({size, size}, torch::kFloat64);
  std::copy(distances.begin(), distances.end(), result.data_ptr<double>());
  return result / static_cast<double>(size);
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
