#include "anigen/loaders/files/view_files.h"

#include <Eigen/Core>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/io/image_crop.h"
#include "anigen/io/image_resize.h"
#include "anigen/raytrace/views/transforms_json.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

raytrace::Frame random_frame(const fs::path& folder, Rng& rng) {
  // At least one frame, and every picture in this folder: read_transforms sees to both.
  const raytrace::Transforms views = raytrace::read_transforms(folder / "transforms.json");
  return views.frames[rng.index(views.frames.size())];
}

fs::path normal_picture(const fs::path& color) {
  const fs::path path = normal_picture_of(color);
  std::error_code error;
  if (fs::is_regular_file(path, error)) return path;
  throw InputError(path.string(), "",
                   "no such picture of normals; prepare the dataset with --view-geometry, or set the dataset's "
                   "condition to color");
}

std::vector<float> planes(const io::Image& image, bool times_alpha) {
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  std::vector<float> values(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* pixel = image.rgba.data() + 4 * i;
    const float alpha = times_alpha ? static_cast<float>(pixel[3]) / 255.0f : 1.0f;
    for (std::size_t c = 0; c < 3; ++c) values[c * pixels + i] = static_cast<float>(pixel[c]) / 255.0f * alpha;
  }
  return values;
}

template <typename Matrix, std::size_t N>
void copy_row_major(const Matrix& matrix, std::array<float, N>& out) {
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
      out[static_cast<std::size_t>(row * matrix.cols() + column)] = static_cast<float>(matrix(row, column));
    }
  }
}

}  // namespace

fs::path normal_picture_of(const fs::path& color) {
  return color.parent_path() / (color.stem().string() + "_normal.png");
}

ViewImage read_view(const fs::path& folder, int size, Rng& rng) {
  const raytrace::Frame frame = random_frame(folder, rng);
  const io::Image picture =
      io::resize_lanczos(io::read_image(folder / frame.file_path), size, size, io::ResizeAlpha::kSeparate);
  ViewImage view;
  view.image = planes(picture, false);
  view.alpha.resize(view.image.size() / 3);
  for (std::size_t i = 0; i < view.alpha.size(); ++i) {
    view.alpha[i] = static_cast<float>(picture.rgba[4 * i + 3]) / 255.0f;
  }
  copy_row_major(raytrace::extrinsics(frame), view.extrinsics);
  copy_row_major(raytrace::intrinsics(frame), view.intrinsics);
  return view;
}

std::vector<float> read_condition_image(const fs::path& folder, int size, Rng& rng, ConditionPictures pictures) {
  const raytrace::Frame frame = random_frame(folder, rng);
  const fs::path color = folder / frame.file_path;
  const fs::path path = pictures == ConditionPictures::kNormals ? normal_picture(color) : color;
  const io::Image picture = io::read_image(path);
  const io::Image object = io::crop(picture, io::condition_box(picture, path.string()));
  return planes(io::resize_lanczos(object, size, size, io::ResizeAlpha::kPremultiplied), true);
}

fs::path first_normal_picture(const fs::path& folder) {
  return normal_picture(folder / raytrace::read_transforms(folder / "transforms.json").frames.front().file_path);
}

}  // namespace anigen::loaders
