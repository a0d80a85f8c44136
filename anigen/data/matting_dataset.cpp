#include "anigen/data/matting_dataset.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/data/backgrounds.h"
#include "anigen/data/view_files.h"
#include "anigen/io/image_resize.h"

namespace anigen::data {

namespace {

constexpr double kLeastScale = 0.5, kMostScale = 1.1;  // of the object's longer side, in sides of the picture
constexpr double kMargin = 1.2;                        // of a cut-out around its object, see io::condition_box
constexpr double kOutside = 0.1;                       // of the picture's side, by which an object may leave it
constexpr int kKeptSides = 3;                          // of pictures in memory, in sides of the result

// Other light and another camera: c → gain (contrast (c − ½) + ½), of a colour that is multiplied by alpha.
// @param alpha of the planes, empty: 1
void change_colors(std::vector<float>& planes, const std::vector<float>& alpha, double spread, Rng& rng) {
  if (spread <= 0.0) return;
  const double brightness = spread * rng.normal();
  const auto contrast = static_cast<float>(std::exp(spread * rng.normal()));
  const std::size_t pixels = planes.size() / 3;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto gain = static_cast<float>(std::exp(brightness + 0.5 * spread * rng.normal()));
    for (std::size_t i = 0; i < pixels; ++i) {
      const float whole = alpha.empty() ? 1.0F : alpha[i];
      float& value = planes[c * pixels + i];
      value = std::clamp(gain * (contrast * (value - 0.5F * whole) + 0.5F * whole), 0.0F, whole);
    }
  }
}

// A soft ellipse on the background, around the lowest part of the object.
void cast_shadow(std::vector<float>& background, const std::vector<float>& alpha, int size, Rng& rng) {
  const double strength = rng.uniform(0.2, 0.8), width = rng.uniform(0.35, 0.7), flatness = rng.uniform(0.1, 0.35);
  const double aside = rng.uniform(-0.15, 0.15), lift = rng.uniform(-0.03, 0.03);
  int left = size, right = -1, bottom = -1;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      if (alpha[static_cast<std::size_t>(y) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x)] < 0.5F)
        continue;
      left = std::min(left, x);
      right = std::max(right, x);
      bottom = y;
    }
  }
  if (right < 0) return;
  const double extent = right - left + 1.0, radius_x = width * extent, radius_y = flatness * radius_x;
  const double middle_x = 0.5 * (left + right) + aside * extent, middle_y = bottom + lift * size;
  const std::size_t pixels = alpha.size();
  for (std::size_t i = 0; i < pixels; ++i) {
    const double x = (static_cast<double>(i % static_cast<std::size_t>(size)) - middle_x) / radius_x;
    const double y = (static_cast<double>(i / static_cast<std::size_t>(size)) - middle_y) / radius_y;
    const auto light = static_cast<float>(1.0 - strength * std::exp(-2.0 * (x * x + y * y)));
    for (std::size_t c = 0; c < 3; ++c) background[c * pixels + i] *= light;
  }
}

void compress(std::vector<float>& planes, int size, int quality) {
  io::Image picture(size, size);
  const std::size_t pixels = planes.size() / 3;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c)
      picture.rgba[4 * i + c] =
          static_cast<std::uint8_t>(std::lround(255.0F * std::clamp(planes[c * pixels + i], 0.0F, 1.0F)));
  }
  planes = io::color_planes(io::decode_image(io::encode_jpeg(picture, quality), "compressed picture"));
}

// Blur, noise and compression of a camera and of who sent the picture on.
void degrade(std::vector<float>& image, const MattingOptions& options, Rng& rng) {
  if (rng.chance(options.blur)) blur_planes(image, options.image_size, rng.uniform(0.2, 1.0));
  if (rng.chance(options.noise)) {
    const double deviation = rng.uniform(0.0, 0.04);
    for (float& value : image) value += static_cast<float>(deviation * rng.normal());
  }
  if (rng.chance(options.jpeg)) compress(image, options.image_size, 40 + static_cast<int>(rng.index(51)));
  for (float& value : image) value = std::clamp(value, 0.0F, 1.0F);
}

// Pictures of a folder, for both training and evaluation. Its share has a default only where there is a folder.
std::shared_ptr<const std::vector<io::Image>> shared_pictures(ConfigReader& reader, const char* share_key,
                                                              const std::filesystem::path& folder, double& share,
                                                              const MattingOptions& options, bool cut_out) {
  if (folder.empty() && !reader.has(share_key)) share = 0.0;
  if (share <= 0.0) return nullptr;
  if (folder.empty()) throw reader.error(share_key, "needs the folder of these pictures");
  const std::filesystem::path there = file_of_dataset(folder.string(), options.sources.data_dir);
  return std::make_shared<const std::vector<io::Image>>(read_pictures(there, kKeptSides * options.image_size, cut_out));
}

}  // namespace

PlacedObject place_object(const io::Image& cutout, int size, double scale, double x, double y, bool mirrored) {
  const double factor = scale * size / std::max(cutout.width, cutout.height);
  const auto side = [&](int length) { return std::max(1, static_cast<int>(std::lround(factor * length))); };
  const int width = side(cutout.width), height = side(cutout.height);
  const io::Image resized = io::resize_lanczos(cutout, width, height, io::ResizeAlpha::kPremultiplied);
  const int left = static_cast<int>(std::lround(x * size - 0.5 * width));
  const int top = static_cast<int>(std::lround(y * size - 0.5 * height));
  const io::Image framed = io::crop(resized, {-left, -top, size - left, size - top});
  PlacedObject object{io::premultiplied_planes(framed), io::alpha_plane(framed)};
  if (!mirrored) return object;
  for (std::vector<float>* planes : {&object.color, &object.alpha}) {
    for (auto row = planes->begin(); row != planes->end(); row += size) std::reverse(row, row + size);
  }
  return object;
}

std::vector<float> before_background(const PlacedObject& object, const std::vector<float>& background) {
  std::vector<float> image(object.color);
  const std::size_t pixels = object.alpha.size();
  for (std::size_t i = 0; i < image.size(); ++i) image[i] += (1.0F - object.alpha[i % pixels]) * background[i];
  return image;
}

MattingOptions MattingOptions::read(ConfigReader& reader) {
  MattingOptions options;
  options.sources.read_common(reader);
  options.sources.filter.required_flags = {"cond_rendered"};
  ConfigFields f(reader);
  f("image_size", options.image_size, {16, 4096});
  f("pictures", options.pictures);
  f("picture_share", options.picture_share, {0.0, 1.0});
  f("backgrounds", options.backgrounds);
  f("background_share", options.background_share, {0.0, 1.0});
  f("jitter", options.jitter, {0.0, 2.0});
  f("shadow", options.shadow, {0.0, 1.0});
  f("blur", options.blur, {0.0, 1.0});
  f("noise", options.noise, {0.0, 1.0});
  f("jpeg", options.jpeg, {0.0, 1.0});
  options.cutouts = shared_pictures(reader, "picture_share", options.pictures, options.picture_share, options, true);
  options.scenes =
      shared_pictures(reader, "background_share", options.backgrounds, options.background_share, options, false);
  return options;
}

struct MattingDataset::Composed : Sample {
  std::vector<float> image, alpha;
};

MattingDataset::MattingDataset(std::vector<AssetId> assets, const MattingOptions& options, std::uint64_t seed)
    : AssetDataset(
          std::move(assets), {seed, options.sources.skip_broken, false},
          {[](const AssetId& asset) { return std::vector{condition_folder(asset) / "transforms.json"}; }, nullptr}),
      options_(options) {}

std::unique_ptr<AssetDataset::Sample> MattingDataset::read(std::size_t index, std::uint64_t position) const {
  Rng rng(seed(), "matting", position);
  const int size = options_.image_size;
  const bool from_picture = rng.chance(options_.picture_share), before_scene = rng.chance(options_.background_share);
  const io::Image cutout = from_picture ? (*options_.cutouts)[rng.index(options_.cutouts->size())]
                                        : read_condition_view(condition_folder(asset(index)), rng);
  const double scale = rng.uniform(kLeastScale, kMostScale);
  const double shift = std::max(0.0, 0.5 * (1.0 - scale) + kOutside);  // of the centre, along either axis
  const double x = 0.5 + rng.uniform(-shift, shift), y = 0.5 + rng.uniform(-shift, shift);
  PlacedObject object = place_object(cutout, size, kMargin * scale, x, y, rng.chance(0.5));
  change_colors(object.color, object.alpha, options_.jitter, rng);
  std::vector<float> background =
      before_scene ? crop_background((*options_.scenes)[rng.index(options_.scenes->size())], size, rng)
                   : draw_background(size, rng);
  change_colors(background, {}, options_.jitter, rng);
  if (rng.chance(options_.shadow)) cast_shadow(background, object.alpha, size, rng);
  auto composed = std::make_unique<Composed>();
  composed->image = before_background(object, background);
  degrade(composed->image, options_, rng);
  composed->alpha = std::move(object.alpha);
  return composed;
}

std::unique_ptr<Batch> MattingDataset::collate(const Samples& samples, const std::vector<std::string>& ids) const {
  auto batch = std::make_unique<MattingBatch>();
  std::vector<const std::vector<float>*> images, alphas;
  for (const auto& sample : samples) {
    const auto& composed = static_cast<const Composed&>(*sample);
    images.push_back(&composed.image);
    alphas.push_back(&composed.alpha);
  }
  const std::int64_t size = options_.image_size;
  batch->image = stack(images, {3, size, size}, ids, "image");
  batch->alpha = stack(alphas, {1, size, size}, ids, "alpha");
  return batch;
}

}  // namespace anigen::data
