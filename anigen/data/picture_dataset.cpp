#include "anigen/data/picture_dataset.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/data/view_files.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/dataset_views.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;

fs::path depth_picture_of(const fs::path& color) {
  return color.parent_path() / (color.stem().string() + "_depth.png");
}

// Depths of a frame, whose picture has `size` pixels on a side.
std::vector<float> read_depths(const fs::path& file, int size) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    throw InputError(file.string(), "", "no such picture of depths; prepare the dataset with --view-geometry");
  }
  int width = 0, height = 0;
  const std::string bytes = read_file(file);
  std::vector<float> depths = render::decode_depth_png({bytes.begin(), bytes.end()}, file.string(), width, height);
  if (width != size || height != size) {
    throw InputError(file.string(), "",
                     "is " + std::to_string(width) + " x " + std::to_string(height) +
                         " pixels, its colour picture has " + std::to_string(size) + " on a side");
  }
  return depths;
}

constexpr float kLeastCoverage = 0.5F, kShortestNormal = 1e-3F;

// Brightness and tint of another light, the same for all pixels.
void relight(std::vector<float>& image, double spread, Rng& rng) {
  if (spread <= 0.0) return;
  const double brightness = spread * rng.normal();
  const std::size_t plane = image.size() / 3;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto factor = static_cast<float>(std::exp(brightness + 0.5 * spread * rng.normal()));
    for (std::size_t i = 0; i < plane; ++i) {
      float& value = image[c * plane + i];
      value = std::min(1.0F, value * factor);
    }
  }
}

}  // namespace

PictureTruth read_picture_truth(const fs::path& folder, int size, Rng& rng) {
  const render::Transforms views = render::read_transforms(folder / "transforms.json");
  const render::Frame& frame = views.frames[rng.index(views.frames.size())];
  const fs::path color_file = folder / frame.file_path;
  const io::Image color = io::read_image(color_file);
  if (color.width != color.height) throw InputError(color_file.string(), "", "a view is square");
  const io::PixelBox box = io::condition_box(color, color_file.string());
  PictureTruth truth;
  const auto planes = [&](const io::Image& whole, int edge) {
    return io::resize_lanczos(io::crop(whole, box), edge, edge, io::ResizeAlpha::kPremultiplied);
  };
  truth.image = io::premultiplied_planes(planes(color, size));
  truth.camera = render::part_camera(frame, box, color.width);

  const int half = size / 2;
  const auto pixels = static_cast<std::size_t>(half) * static_cast<std::size_t>(half);
  truth.normals.assign(3 * pixels, 0.0F);
  truth.coordinates.assign(3 * pixels, 0.0F);
  truth.mask.assign(pixels, 0.0F);
  const fs::path normal_file = normal_picture_of(color_file);
  std::error_code error;
  if (!fs::is_regular_file(normal_file, error)) {
    throw InputError(normal_file.string(), "", "no such picture of normals; prepare the dataset with --view-geometry");
  }
  const io::Image map = io::read_image(normal_file);
  if (map.width != color.width || map.height != color.height)
    throw InputError(normal_file.string(), "", "is not of the size of its colour picture");
  const io::Image normals = planes(map, half);
  const std::vector<float> depths = read_depths(depth_picture_of(color_file), color.width);
  const Eigen::Matrix4d extrinsics = render::extrinsics(frame);
  const Eigen::Matrix3d intrinsics = render::intrinsics(frame);
  const double step_x = static_cast<double>(box.x1 - box.x0) / half;
  const double step_y = static_cast<double>(box.y1 - box.y0) / half;
  for (int y = 0; y < half; ++y) {
    for (int x = 0; x < half; ++x) {
      const double at_x = box.x0 + (x + 0.5) * step_x, at_y = box.y0 + (y + 0.5) * step_y;
      const auto column = static_cast<int>(std::floor(at_x)), row = static_cast<int>(std::floor(at_y));
      if (column < 0 || row < 0 || column >= color.width || row >= color.width) continue;
      const float depth = depths[static_cast<std::size_t>(row) * static_cast<std::size_t>(color.width) +
                                 static_cast<std::size_t>(column)];
      const std::uint8_t* rgba = normals.pixel(x, y);
      if (depth <= 0.0F || static_cast<float>(rgba[3]) < kLeastCoverage * 255.0F) continue;
      Eigen::Vector3f normal;
      for (int c = 0; c < 3; ++c) normal[c] = 2.0F * static_cast<float>(rgba[c]) / 255.0F - 1.0F;
      if (normal.norm() < kShortestNormal) continue;
      normal.normalize();
      // The ray through the middle of that pixel, whose depth was stored.
      const Eigen::Vector3d uv_depth((column + 0.5) / color.width, (row + 0.5) / color.width, depth);
      const Eigen::Vector3d place = render::unproject(uv_depth, extrinsics, intrinsics);
      const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(half) + static_cast<std::size_t>(x);
      truth.mask[i] = 1.0F;
      for (std::size_t c = 0; c < 3; ++c) {
        truth.normals[c * pixels + i] = normal[static_cast<Eigen::Index>(c)];
        truth.coordinates[c * pixels + i] = static_cast<float>(place[static_cast<Eigen::Index>(c)]);
      }
    }
  }
  return truth;
}

PictureOptions PictureOptions::read(ConfigReader& reader) {
  PictureOptions options;
  options.sources.read_common(reader);
  options.sources.filter.required_flags = {"cond_rendered"};
  ConfigFields f(reader);
  f("image_size", options.image_size, {16, 4096});
  if (options.image_size % 2 != 0) throw reader.error("image_size", "must be even: truth is given at half of it");
  f("light", options.light, {0.0, 2.0});
  f("families", options.families);
  if (!options.families.empty()) options.sources.filter.required_columns = {"source"};
  return options;
}

struct PictureDataset::Picture : Sample {
  PictureTruth truth;
  std::int64_t family = -1;
};

PictureDataset::PictureDataset(std::vector<AssetId> assets, const PictureOptions& options, std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, false},
                   {[](const AssetId& asset) {
                      return std::vector{condition_folder(asset) / "transforms.json",
                                         first_normal_picture(condition_folder(asset))};
                    },
                    nullptr}),
      options_(options) {}

std::unique_ptr<AssetDataset::Sample> PictureDataset::read(std::size_t index, std::uint64_t position) const {
  const AssetId& id = asset(index);
  auto picture = std::make_unique<Picture>();
  Rng view(seed(), "condition view", position);
  picture->truth = read_picture_truth(condition_folder(id), options_.image_size, view);
  relight(picture->truth.image, options_.light, view);
  const auto found = std::find(options_.families.begin(), options_.families.end(), id.source);
  if (found != options_.families.end()) picture->family = found - options_.families.begin();
  return picture;
}

std::unique_ptr<Batch> PictureDataset::collate(const Samples& samples, const std::vector<std::string>& ids) const {
  auto batch = std::make_unique<PictureBatch>();
  std::vector<const std::vector<float>*> images, normals, coordinates, masks;
  std::vector<std::int64_t> families;
  for (const auto& sample : samples) {
    const auto& picture = static_cast<const Picture&>(*sample);
    images.push_back(&picture.truth.image);
    normals.push_back(&picture.truth.normals);
    coordinates.push_back(&picture.truth.coordinates);
    masks.push_back(&picture.truth.mask);
    families.push_back(picture.family);
    batch->cameras.push_back(picture.truth.camera);
  }
  const std::int64_t size = options_.image_size, half = size / 2;
  batch->image = stack(images, {3, size, size}, ids, "image");
  batch->normals = stack(normals, {3, half, half}, ids, "normals");
  batch->coordinates = stack(coordinates, {3, half, half}, ids, "coordinates");
  batch->mask = stack(masks, {half, half}, ids, "mask");
  batch->family = torch::tensor(families, torch::kInt64);
  return batch;
}

}  // namespace anigen::data
