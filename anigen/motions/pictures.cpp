#include "anigen/motions/pictures.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/process.h"
#include "anigen/io/image.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::motions {

namespace {

/// Box of an asset in all of these poses, so that the camera keeps still.
Box box_of(const Asset& asset, const std::vector<Pose>& poses) {
  Box box;
  for (const Pose& pose : poses) {
    for (const Eigen::Vector3f& vertex : skin_vertices(asset, pose)) box.extend(vertex.cast<double>());
  }
  return box;
}

std::vector<Pose> poses_of(const Asset& asset, const Animation& clip, int count) {
  std::vector<Pose> poses;
  for (int k = 0; k < count; ++k) poses.push_back(sample(clip, asset.skeleton, clip.duration() * k / count));
  return poses;
}

render::PictureOptions picture_options(const Box& box, int size) {
  render::PictureOptions options;
  options.width = options.height = size;
  options.view.pitch_degrees = 10.0;
  options.view.fit = box;
  options.ground_shadow = true;
  options.ambient_occlusion = false;
  return options;
}

}  // namespace

void write_clip_sheet(const std::filesystem::path& png, const Asset& asset, const Animation& clip) {
  const int moments = clip.duration() > 0.0 ? 8 : 1;
  const std::vector<Pose> poses = poses_of(asset, clip, moments);
  render::PictureOptions options = picture_options(box_of(asset, poses), 240);
  std::vector<render::Tile> tiles;
  for (const double yaw : {35.0, 90.0}) {
    options.view.yaw_degrees = yaw;
    for (int k = 0; k < moments; ++k) {
      throw_if_interrupted();
      render::set_pose(options, asset, poses[static_cast<std::size_t>(k)]);
      char seconds[32];
      std::snprintf(seconds, sizeof seconds, "%.2f s", clip.duration() * k / moments);
      tiles.push_back({render::render(asset, options), seconds});
    }
  }
  render::SheetOptions sheet;
  sheet.columns = moments;
  sheet.gap = 6;
  sheet.text_height = 10;
  sheet.title = clip.name;
  io::write_png(png, render::contact_sheet(tiles, sheet));
}

void write_clip_frames(const std::filesystem::path& folder, const Asset& asset, const Animation& clip) {
  const int count = std::clamp(static_cast<int>(std::lround(24.0 * clip.duration())), 1, 2000);
  const std::vector<Pose> poses = poses_of(asset, clip, count);
  render::PictureOptions options = picture_options(box_of(asset, poses), 480);
  for (int k = 0; k < count; ++k) {
    throw_if_interrupted();
    options.view.yaw_degrees = 35.0 + 360.0 * k / count;
    render::set_pose(options, asset, poses[static_cast<std::size_t>(k)]);
    char name[32];
    std::snprintf(name, sizeof name, "%04d.png", k);
    io::write_png(folder / name, render::render(asset, options));
  }
}

}  // namespace anigen::motions
