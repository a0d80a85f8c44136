#include "anigen/pipeline/image_preprocessing.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/image_resize.h"
#include "anigen/pipeline/preprocessing/grabcut.h"

namespace anigen::pipeline {
namespace {

constexpr int kLongestSideForRemoval = 1024;
constexpr int kForeground = 204;  // alpha above it, 0.8 · 255, decides the crop

bool has_foreground(const std::vector<std::uint8_t>& mask) {
  return std::any_of(mask.begin(), mask.end(), [](std::uint8_t alpha) { return alpha > kForeground; });
}

torch::Tensor batch_of(const io::Image& image) { return features::color_tensor(image).unsqueeze(0); }

/// The choice that "auto" stands for, for this picture.
Background decided(Background asked, const io::Image& image, bool has_network) {
  if (asked != Background::kAuto) return asked;
  if (has_transparency(image)) return Background::kAlpha;
  return has_network ? Background::kNetwork : Background::kGrabCut;
}

/// A supplied map at the size of the picture it belongs to.
io::Image map_of(const InputPicture& map, const io::Image& object, std::vector<std::string>& notices) {
  check_input_picture(map.image, map.name);
  notices.push_back("normals: from " + map.name);
  return supplied_normals(map.image, object.width, object.height, map.name);
}

}  // namespace

ImagePreprocessor::ImagePreprocessor(const PreprocessingOptions& options,
                                     std::shared_ptr<features::NormalEstimator> estimator)
    : options_(options), estimator_(std::move(estimator)) {
  if (options.size < 1 || options.size > io::kMostPixelsPerSide) {
    throw InputError("", "size", "condition pictures of " + std::to_string(options.size) + " pixels on a side");
  }
  if (options.normals == NormalSource::kEstimator && !estimator_) {
    throw InputError("", "normals", "'estimator' needs the weights of a normal estimator");
  }
  if (options.estimator_side < 0) throw InputError("", "normals", "the estimator's largest side is negative");
  const bool removes = options.background == Background::kAuto || options.background == Background::kNetwork;
  if (removes && !options.matting.network.empty()) network_ = std::make_unique<MattingNetwork>(options.matting);
  if (options.background == Background::kNetwork && !network_) {
    throw InputError("", "background", "'network' needs a matting network, an ONNX file");
  }
}

PreprocessedImage ImagePreprocessor::run(const std::filesystem::path& picture,
                                         const std::filesystem::path& normal_map) {
  const InputPicture input = read_input_picture(picture);
  const bool reads = options_.normals == NormalSource::kFile || options_.normals == NormalSource::kAuto;
  if (!reads || normal_map.empty()) return run(input);
  const InputPicture map = read_input_picture(normal_map);
  return run(input, &map);
}

PreprocessedImage ImagePreprocessor::run(const InputPicture& picture, const InputPicture* normal_map) {
  check_input_picture(picture.image, picture.name);
  PreprocessedImage result;
  if (picture.turned) result.notices.emplace_back("turned upright, as its EXIF orientation says");
  const io::Image object = object_of(picture, result.notices);
  std::optional<io::Image> normals = normals_of(picture, normal_map, object, result.notices);
  result.picture = features::inference_image(object, options_.size, picture.name);
  result.picture_tensor = batch_of(result.picture);
  if (normals) {
    result.normals = features::inference_image(with_alpha_of(*normals, object), options_.size, picture.name);
    result.normals_tensor = batch_of(result.normals);
  } else {
    result.normals = result.picture;
    result.normals_tensor = result.picture_tensor;
  }
  return result;
}

io::Image ImagePreprocessor::object_of(const InputPicture& picture, std::vector<std::string>& notices) {
  const io::Image& image = picture.image;
  const bool transparent = has_transparency(image);
  const Background background = decided(options_.background, image, network_ != nullptr);
  if (background == Background::kAlpha) {
    if (!transparent) throw InputError(picture.name, "", "has no transparent pixel, and 'alpha' asks for some");
    notices.emplace_back("background: the picture's own transparency");
    return image;
  }
  if (background == Background::kKeep) {
    notices.emplace_back(transparent ? "background: kept as it is, with its transparency"
                                     : "background: kept; the whole picture counts as the object");
    return image;
  }
  const io::Image opaque = reduced(without_alpha(image), kLongestSideForRemoval);
  const std::string dropped = transparent ? "; the picture's own transparency was not used" : "";
  const bool by_network = background == Background::kNetwork;
  const std::vector<std::uint8_t> mask = by_network ? network_->mask(opaque) : grabcut_mask(opaque);
  if (!has_foreground(mask)) {
    throw InputError(picture.name, "",
                     "no object stands out from the background; give a picture with transparency" +
                         std::string(by_network ? "" : ", name a matting network") + ", or keep the background");
  }
  if (by_network) {
    notices.push_back("background: removed by the network " + options_.matting.network.filename().string() + dropped);
  } else {
    notices.push_back("background: removed by GrabCut, from the colours along the picture's edge" + dropped +
                      "; where it cuts wrongly, give a picture with transparency or name a matting network");
  }
  return cut_out(opaque, mask);
}

std::optional<io::Image> ImagePreprocessor::normals_of(const InputPicture& picture, const InputPicture* normal_map,
                                                       const io::Image& object, std::vector<std::string>& notices) {
  const int width = object.width, height = object.height;
  switch (options_.normals) {
    case NormalSource::kAuto:
      if (normal_map != nullptr) return map_of(*normal_map, object, notices);
      [[fallthrough]];
    case NormalSource::kColors:
      notices.emplace_back("normals: none; the colour picture stands in for them");
      return std::nullopt;
    case NormalSource::kFlat:
      notices.emplace_back("normals: a surface that faces the viewer everywhere");
      return flat_normals(width, height);
    case NormalSource::kFile:
      if (normal_map == nullptr) throw InputError(picture.name, "normals", "'file' needs a normal map beside it");
      return map_of(*normal_map, object, notices);
    case NormalSource::kEstimator:
      break;
  }
  const io::Image estimate = estimated_normals(*estimator_, picture.image, options_.estimator_side, picture.name);
  notices.emplace_back("normals: estimated from the picture");
  return io::resize_lanczos(estimate, width, height, io::ResizeAlpha::kSeparate);
}

}  // namespace anigen::pipeline
