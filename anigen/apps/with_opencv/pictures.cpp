#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "anigen/io/picture_codec.h"

namespace anigen::io {

namespace opencv {

using Outcome = PictureCodec::Outcome;

/// Empty for damaged files.
cv::Mat decoded(const std::vector<std::uint8_t>& bytes) {
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::uint8_t*>(bytes.data()));
    return cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    return {};  // OpenCV's message names its own source lines, not the user's file
  }
}

std::vector<std::uint8_t> encoded_png(const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) bytes.clear();
  return bytes;
}

std::uint8_t to_byte(const cv::Mat& picture, int y, int x, int channel) {
  const int at = x * picture.channels() + channel;
  if (picture.depth() == CV_8U) return picture.ptr<std::uint8_t>(y)[at];
  if (picture.depth() == CV_16U) return static_cast<std::uint8_t>((picture.ptr<std::uint16_t>(y)[at] + 128) / 257);
  return cv::saturate_cast<std::uint8_t>(picture.ptr<float>(y)[at] * 255.0f);
}

StoredPixels layout_of(const cv::Mat& picture) {
  const int depth = picture.depth();
  return {picture.channels(), depth == CV_8U ? 8 : depth == CV_16U ? 16 : 32};
}

bool reads(std::string_view format) {
  return format == "PNG" || format == "JPEG" || format == "BMP" || format == "WebP" || format == "TIFF";
}

Outcome decode(const std::vector<std::uint8_t>& bytes, Image& image, StoredPixels& stored) {
  const cv::Mat picture = decoded(bytes);
  if (picture.empty()) return Outcome::kDamaged;
  const int channels = picture.channels(), depth = picture.depth();
  if (channels > 4 || (depth != CV_8U && depth != CV_16U && depth != CV_32F)) return Outcome::kOtherPixels;
  stored = layout_of(picture);
  image.width = picture.cols;
  image.height = picture.rows;
  image.rgba.assign(std::size_t{kImageChannels} * picture.total(), 255);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      std::uint8_t* pixel = image.pixel(x, y);
      for (int c = 0; c < 3; ++c) pixel[c] = to_byte(picture, y, x, channels >= 3 ? 2 - c : 0);  // OpenCV: BGR
      if (channels == 4 || channels == 2) pixel[3] = to_byte(picture, y, x, channels - 1);
    }
  }
  return Outcome::kDone;
}

Outcome decode_grey16(const std::vector<std::uint8_t>& bytes, Grey16& grey, StoredPixels& stored) {
  const cv::Mat picture = decoded(bytes);
  if (picture.empty()) return Outcome::kDamaged;
  stored = layout_of(picture);
  grey = {picture.cols, picture.rows, {}};
  if (picture.type() != CV_16UC1) return Outcome::kDone;
  for (int y = 0; y < picture.rows; ++y)
    grey.values.insert(grey.values.end(), picture.ptr<std::uint16_t>(y), picture.ptr<std::uint16_t>(y) + picture.cols);
  return Outcome::kDone;
}

std::vector<std::uint8_t> encode_png(const Image& image) {
  cv::Mat picture;
  cv::cvtColor(cv::Mat(image.height, image.width, CV_8UC4, const_cast<std::uint8_t*>(image.rgba.data())), picture,
               cv::COLOR_RGBA2BGRA);
  return encoded_png(picture);
}

std::vector<std::uint8_t> encode_png16(const Grey16& grey) {
  return encoded_png(cv::Mat(grey.height, grey.width, CV_16UC1, const_cast<std::uint16_t*>(grey.values.data())));
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
  cv::Mat picture;
  cv::cvtColor(cv::Mat(image.height, image.width, CV_8UC4, const_cast<std::uint8_t*>(image.rgba.data())), picture,
               cv::COLOR_RGBA2BGR);
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, quality})) bytes.clear();
  return bytes;
}

}  // namespace opencv

/// The entry that opencv_codec() looks for.
extern "C" __attribute__((visibility("default"))) const PictureCodec* anigen_opencv_codec() {
  static constexpr PictureCodec kCodec{opencv::reads,      opencv::decode,       opencv::decode_grey16,
                                       opencv::encode_png, opencv::encode_png16, opencv::encode_jpeg};
  return &kCodec;
}

}  // namespace anigen::io
