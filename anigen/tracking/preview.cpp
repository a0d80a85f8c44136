#include "anigen/tracking/preview.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/process.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"
#include "anigen/render/scene.h"

namespace anigen::tracking {

namespace {

constexpr int kTile = 200;
constexpr std::size_t kMoments = 8;

/// Yaw of a camera as render::Orbit counts it.
double yaw_of(const PinholeCamera& camera) {
  const Eigen::Vector3d forward = camera.world_to_camera.block<1, 3>(2, 0).transpose();
  return std::atan2(-forward.x(), forward.y()) * 180.0 / 3.14159265358979323846;
}

}  // namespace

io::Image tracked_picture(const RigTensors& rig, const TrackedPoses& poses, std::size_t n, const PinholeCamera& camera,
                          int size) {
  const torch::NoGradGuard no_grad;
  const auto at = static_cast<std::int64_t>(n);
  const PosedRig pose = posed(rig, poses.turns.narrow(0, at, 1), poses.shifts.narrow(0, at, 1));
  const Rendering seen =
      render_rig(rig, clip_positions(pose.vertices[0], camera), pose.normals[0], poses.lights[n], 2 * size);
  const auto half = [&](const Tensor& image) {  // [2S, 2S, C] → [S, S, C]
    return at::adaptive_avg_pool2d(image.permute({2, 0, 1}).unsqueeze(0), {size, size}).squeeze(0).permute({1, 2, 0});
  };
  const Tensor mask = half(seen.mask.unsqueeze(2)), color = half(seen.color.square()).contiguous();
  const Tensor alpha = mask.contiguous();
  io::Image image(size, size, 0);
  for (int i = 0; i < size * size; ++i) {
    const double* from = color.data_ptr<double>() + 3 * i;
    const float opacity = static_cast<float>(alpha.data_ptr<double>()[i]);
    render::PixelSum pixel;
    pixel.add(Eigen::Vector3d(from[0], from[1], from[2]).cast<float>(), opacity);
    pixel.store_straight(image.rgba.data() + static_cast<std::ptrdiff_t>(io::kImageChannels) * i, true);
  }
  return image;
}

io::Image comparison_sheet(const Asset& asset, const RigTensors& rig, const std::vector<TrackedFrame>& frames,
                           const TrackedPoses& poses, const Animation& clip, double fps) {
  const std::size_t moments = std::min(kMoments, frames.size());
  std::vector<render::Tile> rows[3];
  Box box;
  std::vector<Pose> shown;
  for (std::size_t k = 0; k < moments; ++k) {
    const std::size_t n = k * frames.size() / moments;
    shown.push_back(sample(clip, asset.skeleton, static_cast<double>(n) / fps));
    for (const Eigen::Vector3f& vertex : skin_vertices(asset, shown.back())) box.extend(vertex.cast<double>());
  }
  render::PictureOptions aside;
  aside.width = aside.height = kTile;
  aside.view.yaw_degrees = yaw_of(frames.front().camera) + 90.0;
  aside.view.pitch_degrees = 10.0;
  aside.view.fit = box;
  for (std::size_t k = 0; k < moments; ++k) {
    throw_if_interrupted();
    const std::size_t n = k * frames.size() / moments;
    char caption[48];
    std::snprintf(caption, sizeof caption, "%.2f s", static_cast<double>(n) / fps);
    rows[0].push_back({io::resize_lanczos(frames[n].image, kTile, kTile, io::ResizeAlpha::kPremultiplied), caption});
    std::snprintf(caption, sizeof caption, "tracked, overlap %.3f", poses.overlaps[n]);
    rows[1].push_back({tracked_picture(rig, poses, n, frames[n].camera, kTile), caption});
    render::set_pose(aside, asset, shown[k]);
    rows[2].push_back({render::render(asset, aside), "from the side"});
  }
  std::vector<render::Tile> tiles;
  for (std::vector<render::Tile>& row : rows) {
    for (render::Tile& tile : row) tiles.push_back(std::move(tile));
  }
  render::SheetOptions sheet;
  sheet.columns = static_cast<int>(moments);
  sheet.gap = 6;
  sheet.text_height = 10;
  sheet.title = clip.name;
  return render::contact_sheet(tiles, sheet);
}

}  // namespace anigen::tracking
