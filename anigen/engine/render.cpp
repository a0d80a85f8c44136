#include "anigen/engine/render.h"

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/io/image.h"
#include "anigen/render/picture.h"

namespace anigen::engine {

namespace {

anigen::render::PictureMode parse_mode(const std::string& word) {
  using anigen::render::PictureMode;
  if (word == "color") return PictureMode::kColor;
  if (word == "normals") return PictureMode::kNormals;
  if (word == "weights") return PictureMode::kWeights;
  throw InputError("", "mode", "\"" + word + "\" is none of color, normals, weights");
}

}  // namespace

Picture render(const Asset& asset, const RenderOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  anigen::render::PictureOptions picture;
  picture.mode = parse_mode(options.mode);
  picture.width = options.width;
  picture.height = options.height;
  picture.skeleton = options.skeleton;
  picture.view.yaw_degrees = options.yaw;
  picture.view.pitch_degrees = options.pitch;
  if (options.transparent) picture.background.reset();
  if (options.clip >= 0) {
    if (static_cast<std::size_t>(options.clip) >= asset.animations.size())
      throw InputError("", "clip", "the asset has " + std::to_string(asset.animations.size()) + " clips");
    if (!std::isfinite(options.time)) throw InputError("", "time", "must be finite");
    const Animation& clip = asset.animations[static_cast<std::size_t>(options.clip)];
    anigen::render::set_pose(picture, asset, sample(clip, asset.skeleton, options.time));
  }
  io::Image image = anigen::render::render(asset, picture);
  throw_if_interrupted();
  return {image.width, image.height, std::move(image.rgba)};
}

std::string png_bytes(const Picture& picture) {
  if (picture.width <= 0 || picture.height <= 0 ||
      picture.rgba.size() != 4 * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height))
    throw InputError("", "picture", "its size and its pixels disagree");
  io::Image image;
  image.width = picture.width;
  image.height = picture.height;
  image.rgba = picture.rgba;
  const std::vector<std::uint8_t> bytes = io::encode_png(image);
  return {bytes.begin(), bytes.end()};
}

}  // namespace anigen::engine
