#include "anigen/io/image.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string_view>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/image_probe.h"

namespace anigen::io {
namespace {

void refuse_size(std::uint64_t width, std::uint64_t height, const std::string& name) {
  if (width == 0 || height == 0) throw InputError(name, "", "picture without pixels");
  if (width <= kMostPixelsPerSide && height <= kMostPixelsPerSide) return;
  throw InputError(name, "",
                   "picture of " + std::to_string(width) + " x " + std::to_string(height) +
                       " pixels exceeds the limit of " + std::to_string(kMostPixelsPerSide) + " on a side");
}

void require_pixels(const Image& image) {
  const std::size_t expected = 4 * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (image.width > 0 && image.height > 0 && image.rgba.size() == expected) return;
  throw InputError("", "",
                   "picture of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                       " pixels with " + std::to_string(image.rgba.size()) + " bytes cannot be encoded");
}

// Keeps the picture as stored: alpha, no turning by EXIF orientation (textures and datasets count on the rows).
cv::Mat decode(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::uint8_t*>(bytes.data()));
    cv::Mat picture = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
    if (!picture.empty()) return picture;
  } catch (const cv::Exception&) {
    // Fall through: OpenCV's message names its own source lines, not the user's file.
  } catch (const std::bad_alloc&) {
    throw InputError(name, "", "picture does not fit into memory");
  }
  throw InputError(name, "", "cannot be decoded as a picture (damaged, or an unknown format)");
}

std::uint8_t to_byte(const cv::Mat& picture, int y, int x, int channel) {
  const int at = x * picture.channels() + channel;
  switch (picture.depth()) {
    case CV_8U:
      return picture.ptr<std::uint8_t>(y)[at];
    case CV_16U:
      return static_cast<std::uint8_t>((picture.ptr<std::uint16_t>(y)[at] + 128) / 257);
    default:
      return cv::saturate_cast<std::uint8_t>(picture.ptr<float>(y)[at] * 255.0f);
  }
}

}  // namespace

Image::Image(int width, int height, std::uint32_t rgba_fill) : width(width), height(height) {
  if (width < 0 || height < 0) throw InputError("", "", "a picture cannot have a negative size");
  rgba.resize(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (std::size_t i = 0; i < rgba.size(); ++i) rgba[i] = static_cast<std::uint8_t>(rgba_fill >> (24 - 8 * (i % 4)));
}

Image decode_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors, StoredPixels* stored) {
  if (bytes.empty()) throw InputError(name_for_errors, "", "picture of zero bytes");
  if (bytes.size() > std::size_t{1} << 30) throw InputError(name_for_errors, "", "picture file larger than 1 GiB");
  // Before OpenCV allocates what a hostile header asks for.
  const PictureSize announced = probe_picture(bytes, name_for_errors);
  if (announced.known) refuse_size(announced.width, announced.height, name_for_errors);
  const cv::Mat picture = decode(bytes, name_for_errors);
  refuse_size(static_cast<std::uint64_t>(picture.cols), static_cast<std::uint64_t>(picture.rows), name_for_errors);
  const int channels = picture.channels(), depth = picture.depth();
  if (channels > 4 || (depth != CV_8U && depth != CV_16U && depth != CV_32F)) {
    throw NotSupportedError(name_for_errors, "", "this pixel type of a picture");
  }
  if (stored != nullptr) *stored = {channels, depth == CV_8U ? 8 : depth == CV_16U ? 16 : 32};
  Image image(picture.cols, picture.rows);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      std::uint8_t* pixel = image.pixel(x, y);
      for (int c = 0; c < 3; ++c) pixel[c] = to_byte(picture, y, x, channels >= 3 ? 2 - c : 0);  // OpenCV: BGR
      if (channels == 4 || channels == 2) pixel[3] = to_byte(picture, y, x, channels - 1);
    }
  }
  return image;
}

Image read_image(const std::filesystem::path& path) {
  const std::string bytes = read_file(path, std::uintmax_t{1} << 30);
  return decode_image({bytes.begin(), bytes.end()}, path.string());
}

std::vector<std::uint8_t> encode_png(const Image& image) {
  require_pixels(image);
  cv::Mat picture(image.height, image.width, CV_8UC4);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::uint8_t* pixel = image.pixel(x, y);
      picture.at<cv::Vec4b>(y, x) = {pixel[2], pixel[1], pixel[0], pixel[3]};
    }
  }
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) throw Error("cannot encode a picture as PNG");
  return bytes;
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
  require_pixels(image);
  cv::Mat picture(image.height, image.width, CV_8UC3);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::uint8_t* pixel = image.pixel(x, y);
      const auto over_white = [&](int channel) {
        return static_cast<std::uint8_t>((pixel[channel] * pixel[3] + 255 * (255 - pixel[3]) + 127) / 255);
      };
      picture.at<cv::Vec3b>(y, x) = {over_white(2), over_white(1), over_white(0)};
    }
  }
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, quality}))
    throw Error("cannot encode a picture as JPEG");
  return bytes;
}

void write_png(const std::filesystem::path& path, const Image& image) {
  const std::vector<std::uint8_t> bytes = encode_png(image);
  write_file_atomically(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace anigen::io
