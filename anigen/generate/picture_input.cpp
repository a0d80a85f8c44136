#include "anigen/generate/picture_input.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/data/view_files.h"
#include "anigen/generate/grabcut.h"
#include "anigen/io/foreign_image.h"
#include "anigen/io/image_resize.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/render/cameras_json.h"

namespace anigen::generate {

namespace {

constexpr std::uintmax_t kMostFileBytes = std::uintmax_t{1} << 30;

void refuse_picture_size(std::uint64_t width, std::uint64_t height, const std::string& name) {
  const std::string size = "a picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels";
  if (width < kLeastPictureSide || height < kLeastPictureSide) {
    throw InputError(name, "",
                     size + " is too small to show an object: each side needs " + std::to_string(kLeastPictureSide));
  }
  const auto side = static_cast<std::uint64_t>(io::kMostPixelsPerSide);
  if (width > side || height > side || width * height > static_cast<std::uint64_t>(kMostPicturePixels)) {
    throw InputError(name, "",
                     size + " is too large: up to " + std::to_string(side) + " on a side and " +
                         std::to_string(kMostPicturePixels / 1'000'000) + " million in all; make it smaller");
  }
}

bool is_invisible(const io::Image& image) {
  for (std::size_t i = 3; i < image.rgba.size(); i += io::kImageChannels) {
    if (image.rgba[i] != 0) return false;
  }
  return true;
}

using torch::Tensor;

constexpr std::uint32_t kFacingTheViewer = 0x8080FFFFu;  // RGBA

io::Image opaque_resized(const io::Image& image, int width, int height) {
  return io::resize_lanczos(without_alpha(image), width, height, io::ResizeAlpha::kSeparate);
}

constexpr int kLongestSideForRemoval = 1024;
constexpr int kForeground = 204;  // alpha above it, 0.8 · 255, decides the crop

bool has_foreground(const std::vector<std::uint8_t>& mask) {
  return std::any_of(mask.begin(), mask.end(), [](std::uint8_t alpha) { return alpha > kForeground; });
}

torch::Tensor batch_of(const io::Image& image) { return vision::color_tensor(image).unsqueeze(0); }

/// Grey and opaque.
io::Image grey_picture(const std::vector<std::uint8_t>& grey, int width, int height) {
  io::Image image(width, height);
  for (std::size_t i = 0; i < grey.size(); ++i) std::fill_n(image.rgba.data() + io::kImageChannels * i, 3, grey[i]);
  return image;
}

std::vector<std::uint8_t> channel_of(const io::Image& image, std::size_t channel) {
  std::vector<std::uint8_t> values(image.rgba.size() / io::kImageChannels);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = image.rgba[io::kImageChannels * i + channel];
  return values;
}

/// The choice that "auto" stands for, for this picture.
Background decided(Background asked, const io::Image& image, bool has_network) {
  if (asked != Background::kAuto) return asked;
  if (io::has_transparency(image)) return Background::kAlpha;
  return has_network ? Background::kNetwork : Background::kGrabCut;
}

// @throws InputError for a picture with a side below kLeastPictureSide or above io::kMostPixelsPerSide, with more
// than kMostPicturePixels, or in which every pixel is fully transparent
void check_input_picture(const io::Image& image, const std::string& name) {
  if (image.width <= 0 || image.height <= 0) throw InputError(name, "", "picture without pixels");
  refuse_picture_size(static_cast<std::uint64_t>(image.width), static_cast<std::uint64_t>(image.height), name);
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (image.rgba.size() != io::kImageChannels * pixels) throw InputError(name, "", "the picture is incomplete");
  if (is_invisible(image)) throw InputError(name, "", "every pixel is fully transparent: there is no object to see");
}

/// A supplied map at the size of the picture it belongs to.
io::Image map_of(const InputPicture& map, const io::Image& object, std::vector<std::string>& notices) {
  check_input_picture(map.image, map.name);
  notices.push_back("normals: from " + map.name);
  return supplied_normals(map.image, object.width, object.height, map.name);
}

// A PNG, JPEG (CMYK too), WebP, BMP or TIFF of any depth, as 8-bit RGBA: grey becomes three equal channels, 16 bit
// are rounded to 8, palettes are resolved with their alpha.
InputPicture decoded_picture(const std::string& file, const std::string& name) {
  const std::vector<std::uint8_t> bytes(file.begin(), file.end());
  InputPicture picture;
  picture.name = name;
  if (!bytes.empty()) {  // before the pixels are decoded
    const io::PictureSize announced = io::probe_picture(bytes, picture.name);
    if (announced.known) refuse_picture_size(announced.width, announced.height, picture.name);
  }
  picture.image = io::decode_foreign_image(bytes, picture.name);
  const int orientation = io::exif_orientation(bytes);
  picture.turned = orientation != 1;
  if (picture.turned) picture.image = io::upright(picture.image, orientation);
  check_input_picture(picture.image, picture.name);
  return picture;
}

InputPicture read_input_picture(const std::filesystem::path& path) {
  return decoded_picture(read_file(path, kMostFileBytes), path.string());
}

// The estimate for a whole picture, its alpha ignored.
io::Image estimated_normals(vision::NormalEstimator& estimator, const io::Image& image, int largest_side,
                            const std::string& name) {
  const io::Image opaque = without_alpha(image);
  const io::Image seen = largest_side > 0 ? reduced(opaque, largest_side) : opaque;
  try {
    const torch::NoGradGuard no_grad;
    const Tensor normals = estimator.normals(vision::color_tensor(seen).unsqueeze(0));
    return opaque_resized(normal_picture(normals), image.width, image.height);
  } catch (const InputError& error) {
    throw InputError(name, error.place(), error.problem());
  }
}

/// The part of a picture that a mask marks. Of a picture with transparency the mask decides, too: what is hidden in it
/// is seen again. @throws InputError
io::Image cut_by_mask(const InputPicture& picture, const InputPicture& mask) {
  check_input_picture(mask.image, mask.name);
  const int width = mask.image.width, height = mask.image.height;
  if (width != picture.image.width || height != picture.image.height) {
    throw InputError(mask.name, "",
                     "a mask of " + std::to_string(width) + " x " + std::to_string(height) +
                         " pixels is not of the size of its picture, " + std::to_string(picture.image.width) + " x " +
                         std::to_string(picture.image.height));
  }
  std::vector<std::uint8_t> alpha(mask.image.rgba.size() / io::kImageChannels);
  for (std::size_t i = 0; i < alpha.size(); ++i) {
    const std::uint8_t* pixel = mask.image.rgba.data() + io::kImageChannels * i;
    const int thrice = (pixel[0] + pixel[1] + pixel[2]) * pixel[3];
    alpha[i] = 2 * thrice > 3 * 255 * 255 ? 255 : 0;
  }
  alpha = channel_of(reduced(grey_picture(alpha, width, height), kLongestSideForRemoval), 0);
  if (!has_foreground(alpha)) throw InputError(mask.name, "", "marks no object: nothing in it is above half");
  return cut_out(reduced(without_alpha(picture.image), kLongestSideForRemoval), alpha);
}

}  // namespace

namespace fs = std::filesystem;

NamedPicture::NamedPicture(fs::path picture) : file(std::move(picture)), name(file.stem().string()) {}
NamedPicture::NamedPicture(fs::path picture, std::string called) : file(std::move(picture)), name(std::move(called)) {}

std::vector<NamedPicture> pictures_at(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return {NamedPicture(path)};
  const std::vector<fs::path> pictures = io::picture_files(path);
  return {pictures.begin(), pictures.end()};
}

NamedPicture views_of_one(std::vector<NamedPicture> pictures) {
  if (pictures.empty()) throw InputError("", "views", "no image of the object");
  if (pictures.size() > kMostViews) {
    throw InputError("", "views",
                     std::to_string(pictures.size()) + " images of one object; up to " + std::to_string(kMostViews));
  }
  NamedPicture one = std::move(pictures.front());
  one.others.assign(std::make_move_iterator(pictures.begin() + 1), std::make_move_iterator(pictures.end()));
  return one;
}

std::vector<NamedPicture> pictures_of_dataset(const fs::path& dataset, const std::vector<fs::path>& splits,
                                              std::size_t most, std::size_t views) {
  if (splits.empty()) throw InputError("", "--split", "which assets' pictures? A file of ids, such as splits/test.txt");
  std::vector<NamedPicture> pictures;
  std::error_code missing;
  std::set<std::string> known, seen;
  io::NameIndex index;
  if (fs::exists(dataset / "metadata.csv", missing)) {
    for (const io::DatasetItem& item : io::list_dataset(dataset)) {
      known.insert(item.id);
      index.add(item.id, item.other_names);
    }
  }
  for (const fs::path& split : splits) {
    for (const io::SplitLine& line : io::read_split(split)) {
      if (most > 0 && pictures.size() == most) return pictures;
      const std::string place = "line " + std::to_string(line.line);
      std::string id = known.count(line.id) > 0 ? line.id : index.find_one(line.id, split.string(), place);
      if (id.empty()) id = line.id;  // a folder of pictures without a table
      if (!seen.insert(id).second) continue;
      const fs::path folder = dataset / "renders_cond" / id;
      std::error_code error;
      if (id.find('/') != std::string::npos || !fs::is_regular_file(folder / "transforms.json", error)) {
        throw InputError(split.string(), place,
                         "asset '" + line.id + "' has no condition views in " + dataset.string() +
                             "; anigen-prepare --cond-views makes them");
      }
      const auto frames = render::read_transforms(folder / "transforms.json").frames;
      if (frames.size() < views) {
        throw InputError(split.string(), place,
                         "asset '" + line.id + "' has " + std::to_string(frames.size()) + " condition views, " +
                             std::to_string(views) + " are asked for");
      }
      std::vector<NamedPicture> seen_of_one;
      for (std::size_t view = 0; view < views; ++view) {
        const fs::path picture = folder / frames[view * frames.size() / views].file_path;
        seen_of_one.emplace_back(picture, id);
        const fs::path normals = data::normal_picture_of(picture);
        if (fs::is_regular_file(normals, error)) seen_of_one.back().normal_map = normals;
      }
      pictures.push_back(views_of_one(std::move(seen_of_one)));
    }
  }
  return pictures;
}

void require_distinct_names(const std::vector<NamedPicture>& pictures) {
  std::set<std::string> seen;
  for (const NamedPicture& picture : pictures) {
    const std::string& name = picture.name;
    if (name.empty() || name == "." || name == "..")
      throw InputError(picture.file.string(), "", "has no name that a folder could have");
    if (!seen.insert(name).second) throw InputError("", "--image", "two pictures have the name '" + name + "'");
  }
}

NormalSource parse_normal_source(const std::string& word) { return chosen("normals", word, kNormalSourceWords); }

io::Image normal_picture(const Tensor& normals) {
  TORCH_CHECK(normals.dim() == 4 && normals.size(0) == 1 && normals.size(1) == 3, "normals of one picture");
  const Tensor here = normals.detach().to(torch::kCPU, torch::kFloat32);
  if (!here.isfinite().all().item<bool>()) throw InputError("", "normals", "the estimate holds numbers not finite");
  const Tensor viewer = here * torch::tensor({-1.0F, 1.0F, 1.0F}).view({1, 3, 1, 1});
  const Tensor bytes =
      ((viewer + 1) / 2 * 255).clamp(0, 255).to(torch::kUInt8)[0].permute({1, 2, 0}).contiguous();  // [H, W, 3]
  io::Image image(static_cast<int>(bytes.size(1)), static_cast<int>(bytes.size(0)));
  const std::uint8_t* from = bytes.data_ptr<std::uint8_t>();
  for (std::size_t i = 0; i < image.rgba.size(); i += io::kImageChannels) {
    std::copy_n(from, 3, image.rgba.begin() + static_cast<std::ptrdiff_t>(i));
    from += 3;
  }
  return image;
}

io::Image supplied_normals(const io::Image& map, int width, int height, const std::string& name) {
  const double across = static_cast<double>(map.width) / width, down = static_cast<double>(map.height) / height;
  // A hundredth, or what a pixel makes of a small picture.
  const double allowed = std::max({0.01, 1.0 / std::min(width, height), 1.0 / std::min(map.width, map.height)});
  if (std::abs(across / down - 1.0) > allowed) {
    throw InputError(name, "",
                     "a normal map of " + std::to_string(map.width) + " x " + std::to_string(map.height) +
                         " pixels does not fit a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                         ": both must show the same frame");
  }
  return opaque_resized(map, width, height);
}

io::Image flat_normals(int width, int height) { return {width, height, kFacingTheViewer}; }

ImagePreprocessor::ImagePreprocessor(const PreprocessingOptions& options,
                                     std::shared_ptr<vision::NormalEstimator> estimator)
    : options_(options), estimator_(std::move(estimator)) {
  if (options.size < 1 || options.size > io::kMostPixelsPerSide)
    throw InputError("", "size", "condition pictures of " + std::to_string(options.size) + " pixels on a side");
  if (options.normals == NormalSource::kEstimator && !estimator_)
    throw InputError("", "normals", "'estimator' needs the weights of a normal estimator");
  if (options.estimator_side < 0) throw InputError("", "normals", "the estimator's largest side is negative");
  const bool removes = options.background == Background::kAuto || options.background == Background::kNetwork;
  if (removes && options.matting.is_run()) {
    const MattingOptions usual;
    if (options.matting.mean != usual.mean || options.matting.deviation != usual.deviation) {
      throw InputError(options.matting.network.string(), "matting network",
                       "a trained run takes neither a mean nor a deviation: these are of ONNX files");
    }
    trained_ = std::make_unique<TrainedMatting>(options.matting.network);
  } else if (removes && !options.matting.network.empty()) {
    network_ = std::make_unique<MattingNetwork>(options.matting);
  }
  if (options.background == Background::kNetwork && !network_ && !trained_)
    throw InputError("", "background", "'network' needs a matting network, a trained run or an ONNX file");
}

io::Image picture_of(const ObjectMask& mask) {
  return io::resize_lanczos(grey_picture(mask.alpha, mask.width, mask.height), mask.picture_width, mask.picture_height,
                            io::ResizeAlpha::kSeparate);
}

PreprocessedImage ImagePreprocessor::run(const NamedPicture& picture) {
  const auto read = [](const std::filesystem::path& file, const std::string& contents) {
    return contents.empty() ? read_input_picture(file) : decoded_picture(contents, file.string());
  };
  const InputPicture input = read(picture.file, picture.contents);
  std::optional<InputPicture> mask, map;
  if (!picture.mask.empty()) mask = read(picture.mask, picture.mask_contents);
  const bool takes_map = options_.normals == NormalSource::kFile || options_.normals == NormalSource::kAuto;
  if (takes_map && !picture.normal_map.empty()) map = read_input_picture(picture.normal_map);
  return run(input, map ? &*map : nullptr, mask ? &*mask : nullptr);
}

PreprocessedImage ImagePreprocessor::run(const InputPicture& picture, const InputPicture* normal_map,
                                         const InputPicture* mask) {
  check_input_picture(picture.image, picture.name);
  PreprocessedImage result;
  if (picture.turned) result.notices.emplace_back("turned upright, as its EXIF orientation says");
  const io::Image object = mask != nullptr ? cut_by_mask(picture, *mask) : object_of(picture, result.notices);
  if (mask != nullptr) result.notices.push_back("background: removed by the mask " + mask->name);
  result.mask = {object.width, object.height, picture.image.width, picture.image.height, channel_of(object, 3)};
  std::optional<io::Image> normals = normals_of(picture, normal_map, object, result.notices);
  result.picture = vision::inference_image(object, options_.size, picture.name);
  result.picture_tensor = batch_of(result.picture);
  result.part = io::crop(object, io::inference_box(object, picture.name));
  if (result.part.width > kMostPartPixels) {
    result.part = io::resize_lanczos(result.part, kMostPartPixels, kMostPartPixels, io::ResizeAlpha::kPremultiplied);
  }
  if (normals) {
    result.normals = vision::inference_image(with_alpha_of(*normals, object), options_.size, picture.name);
    result.normals_tensor = batch_of(result.normals);
  } else {
    result.normals = result.picture;
    result.normals_tensor = result.picture_tensor;
  }
  return result;
}

io::Image ImagePreprocessor::object_of(const InputPicture& picture, std::vector<std::string>& notices) {
  const io::Image& image = picture.image;
  const bool transparent = io::has_transparency(image);
  const Background background = decided(options_.background, image, network_ || trained_);
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
  const std::vector<std::uint8_t> mask = !by_network ? grabcut_mask(opaque)
                                         : trained_  ? trained_->mask(opaque, picture.name)
                                                     : network_->mask(opaque);
  if (!has_foreground(mask)) {
    throw InputError(picture.name, "",
                     "no object stands out from the background; give a picture with transparency" +
                         std::string(by_network ? "" : ", name a matting network") + ", or keep the background");
  }
  if (by_network) {
    const std::filesystem::path& network = options_.matting.network;
    notices.push_back(trained_ ? "background: removed by the trained network " +
                                     (network / "x").parent_path().filename().string() + dropped
                               : "background: removed by the network " + network.filename().string() + dropped);
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

}  // namespace anigen::generate
