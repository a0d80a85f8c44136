#include "anigen/raytrace/views/view_encoding.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "anigen/core/error.h"
#include "anigen/io/image_probe.h"

namespace anigen::raytrace {
namespace {

template <typename Channel>
void require(const ViewImages& view, const Channel& channel, const char* name) {
  const auto pixels = static_cast<std::size_t>(view.size) * static_cast<std::size_t>(view.size);
  if (view.size > 0 && channel.size() == pixels) return;
  throw InputError("", name, "the view was rendered without this channel");
}

io::NdArray array3(const std::vector<Eigen::Vector3f>& values, std::int64_t size) {
  std::vector<float> numbers;
  numbers.reserve(3 * values.size());
  for (const Eigen::Vector3f& value : values) numbers.insert(numbers.end(), value.data(), value.data() + 3);
  return io::NdArray::from(numbers, {size, size, 3});
}

}  // namespace

io::Image encode_world_normals(const ViewImages& view) {
  require(view, view.normal, "normal");
  require(view, view.mask, "mask");
  io::Image image(view.size, view.size, 0);
  for (std::size_t i = 0; i < view.normal.size(); ++i) {
    if (view.mask[i] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const float value = 127.5f * (view.normal[i][static_cast<Eigen::Index>(c)] + 1.0f);
      image.rgba[4 * i + c] = static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0f, 255.0f)));
    }
    image.rgba[4 * i + 3] = 255;
  }
  return image;
}

io::Image encode_condition_normals(const ViewImages& view, const Frame& frame) {
  require(view, view.mean_normal, "mean_normal");
  require(view, view.coverage, "coverage");
  const Eigen::Matrix3f to_camera = frame.camera_to_world.topLeftCorner<3, 3>().transpose().cast<float>();
  io::Image image(view.size, view.size, 0);
  for (std::size_t i = 0; i < view.mean_normal.size(); ++i) {
    if (view.coverage[i] <= 0.0f) continue;
    const Eigen::Vector3f normal = to_camera * view.mean_normal[i];
    for (std::size_t c = 0; c < 3; ++c) {
      // Truncated as published; the small term keeps a length one bit below 1 from falling a whole grey level.
      const float value = 127.5f * (normal[static_cast<Eigen::Index>(c)] + 1.0f) + 1e-3f;
      image.rgba[4 * i + c] = static_cast<std::uint8_t>(std::clamp(value, 0.0f, 255.0f));
    }
    image.rgba[4 * i + 3] = static_cast<std::uint8_t>(std::lround(255.0f * view.coverage[i]));
  }
  return image;
}

std::vector<std::uint8_t> encode_depth_png(const ViewImages& view) {
  require(view, view.depth, "depth");
  cv::Mat picture(view.size, view.size, CV_16UC1);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    const double steps = std::round(kDepthUnits * static_cast<double>(view.depth[i]));
    if (!(steps >= 0.0 && steps <= 65535.0)) {
      throw InputError("", "depth", "a depth of " + std::to_string(view.depth[i]) + " does not fit the 16-bit picture");
    }
    const bool surface = view.depth[i] > 0.0f;
    picture.ptr<std::uint16_t>(static_cast<int>(i) / view.size)[static_cast<int>(i) % view.size] =
        static_cast<std::uint16_t>(surface ? std::max(1.0, steps) : 0.0);
  }
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) throw Error("cannot encode a depth picture as PNG");
  return bytes;
}

std::vector<float> decode_depth_png(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                                    int& width, int& height) {
  const io::PictureSize size = io::probe_picture(bytes, name_for_errors);
  if (!size.known || size.width < 1 || size.height < 1 || size.width > 16384 || size.height > 16384) {
    throw InputError(name_for_errors, "", "not a depth picture, or larger than 16384 pixels on a side");
  }
  cv::Mat picture;
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::uint8_t*>(bytes.data()));
    picture = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    // The message would name OpenCV's source lines; what follows names the file.
  }
  if (picture.empty()) throw InputError(name_for_errors, "", "the depth picture cannot be decoded");
  if (picture.type() != CV_16UC1) throw InputError(name_for_errors, "", "a depth picture has one channel of 16 bits");
  width = picture.cols;
  height = picture.rows;
  std::vector<float> depth;
  depth.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      depth.push_back(static_cast<float>(picture.ptr<std::uint16_t>(y)[x] / kDepthUnits));
    }
  }
  return depth;
}

io::NamedArrays view_arrays(const ViewImages& view) {
  const std::int64_t size = view.size;
  io::NamedArrays arrays;
  if (!view.depth.empty()) arrays.emplace_back("depth", io::NdArray::from(view.depth, {size, size}));
  if (!view.normal.empty()) arrays.emplace_back("normal", array3(view.normal, size));
  if (!view.mask.empty()) arrays.emplace_back("mask", io::NdArray::from(view.mask, {size, size}));
  if (!view.face.empty()) arrays.emplace_back("face", io::NdArray::from(view.face, {size, size}));
  if (!view.barycentric.empty()) arrays.emplace_back("barycentric", array3(view.barycentric, size));
  return arrays;
}

}  // namespace anigen::raytrace
