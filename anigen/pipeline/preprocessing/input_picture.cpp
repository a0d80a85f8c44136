#include "anigen/pipeline/preprocessing/input_picture.h"

#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/image_orientation.h"
#include "anigen/io/image_probe.h"

namespace anigen::pipeline {
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

}  // namespace

InputPicture read_input_picture(const std::filesystem::path& path) {
  const std::string file = read_file(path, kMostFileBytes);
  const std::vector<std::uint8_t> bytes(file.begin(), file.end());
  InputPicture picture;
  picture.name = path.string();
  if (!bytes.empty()) {  // before the pixels are decoded
    const io::PictureSize announced = io::probe_picture(bytes, picture.name);
    if (announced.known) refuse_picture_size(announced.width, announced.height, picture.name);
  }
  picture.image = io::decode_image(bytes, picture.name);
  const int orientation = io::exif_orientation(bytes);
  picture.turned = orientation != 1;
  if (picture.turned) picture.image = io::upright(picture.image, orientation);
  check_input_picture(picture.image, picture.name);
  return picture;
}

void check_input_picture(const io::Image& image, const std::string& name) {
  if (image.width <= 0 || image.height <= 0) throw InputError(name, "", "picture without pixels");
  refuse_picture_size(static_cast<std::uint64_t>(image.width), static_cast<std::uint64_t>(image.height), name);
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (image.rgba.size() != io::kImageChannels * pixels) throw InputError(name, "", "the picture is incomplete");
  if (is_invisible(image)) {
    throw InputError(name, "", "every pixel is fully transparent: there is no object to see");
  }
}

}  // namespace anigen::pipeline
