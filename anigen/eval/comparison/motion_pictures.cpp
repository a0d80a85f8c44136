#include "anigen/eval/comparison/motion_pictures.h"

#include <algorithm>
#include <cstdio>
#include <system_error>
#include <utility>

#include "anigen/asset/skinning.h"
#include "anigen/core/base64.h"
#include "anigen/core/error.h"
#include "anigen/core/html.h"
#include "anigen/eval/comparison/file_name.h"
#include "anigen/eval/motion/retarget.h"
#include "anigen/io/gltf.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTruth = "ground truth";
constexpr std::size_t kMostInReport = 24;  ///< frames: a strip of more would not fit into one picture

bool can_move(const io::RiggedShape& shape) { return shape.has_skin() && shape.has_surface(); }

Asset moving(const io::RiggedShape& shape, const Motion& motion) {
  Asset asset = to_asset(shape);
  asset.animations = {to_animation(retarget(motion, io::joint_tree(asset.skeleton)), asset.skeleton)};
  return asset;
}

const std::vector<double>& times_of(const Asset& asset) { return asset.animations.front().channels.front().times; }

Pose pose_at(const Asset& asset, double time) { return sample(asset.animations.front(), asset.skeleton, time); }

Box box_of_motion(const Asset& asset) {
  Box box;
  for (const double time : times_of(asset)) {
    for (const Eigen::Vector3f& vertex : skin_vertices(asset, pose_at(asset, time))) box.extend(vertex.cast<double>());
  }
  return box;
}

raytrace::Tile tile_of(const MovingRig& rig, double time, const Box& box, int size) {
  if (!rig.asset) return {io::Image(size, size), rig.label + ": none"};
  raytrace::PictureOptions options;
  options.width = options.height = size;
  options.ambient_occlusion = false;
  options.mode = raytrace::PictureMode::kWeights;
  options.view.fit = box;
  raytrace::set_pose(options, *rig.asset, pose_at(*rig.asset, time));
  return {raytrace::render(*rig.asset, options), rig.label};
}

}  // namespace

std::vector<MovingRig> moving_rigs(const std::vector<MotionRow>& rows, const PairSettings& settings,
                                   const Motion* given) {
  std::vector<MovingRig> rigs(1);
  rigs[0].label = kTruth;
  for (const MotionRow& row : rows) {
    rigs.push_back({row.label, std::nullopt});
    if (!row.shapes || !can_move(row.shapes->truth) || !can_move(row.shapes->predicted)) continue;
    const Motion motion = same_motion(*row.shapes, settings, given).truth;
    if (!rigs[0].asset) rigs[0].asset = moving(row.shapes->truth, motion);
    rigs.back().asset = moving(row.shapes->predicted, motion);
  }
  if (!rigs[0].asset) throw InputError("", "", "no prediction of it that could move beside the ground truth");
  return rigs;
}

std::vector<io::Image> motion_frames(const std::vector<MovingRig>& rigs, int size) {
  const Box box = box_of_motion(*rigs[0].asset);
  raytrace::SheetOptions sheet;
  constexpr std::size_t kColumns = 5;
  sheet.columns = static_cast<int>(std::min(rigs.size(), kColumns));
  sheet.gap = 4;
  std::vector<io::Image> frames;
  for (const double time : times_of(*rigs[0].asset)) {
    std::vector<raytrace::Tile> tiles;
    for (const MovingRig& rig : rigs) tiles.push_back(tile_of(rig, time, box, size));
    frames.push_back(raytrace::contact_sheet(tiles, sheet));
  }
  return frames;
}

void write_motion(const fs::path& folder, const std::vector<MovingRig>& rigs, const std::vector<io::Image>& frames) {
  char name[32];
  const auto frame_file = [&](std::size_t f) {
    std::snprintf(name, sizeof name, "frame_%03zu.png", f);
    return folder / name;
  };
  for (std::size_t f = 0; f < frames.size(); ++f) io::write_png(frame_file(f), frames[f]);
  // Of an earlier run with more frames.
  std::error_code ignored;
  for (std::size_t f = frames.size(); fs::remove(frame_file(f), ignored); ++f) {
  }
  for (std::size_t r = 0; r < rigs.size(); ++r) {
    if (rigs[r].asset)
      io::write_gltf(folder / ((r == 0 ? "truth" : file_name(rigs[r].label)) + ".glb"), *rigs[r].asset);
  }
}

std::string motion_html(const MotionStrip& strip) {
  std::string text = "<figure><figcaption><b>" + html_escaped(strip.id) + "</b></figcaption>\n";
  if (strip.frames.empty())
    return text + "<p class=\"failed\">No picture: " + html_escaped(strip.problem) + "</p></figure>\n";
  const std::size_t step = (strip.frames.size() + kMostInReport - 1) / kMostInReport;
  std::vector<raytrace::Tile> tiles;
  for (std::size_t f = 0; f < strip.frames.size(); f += step) tiles.push_back({strip.frames[f], ""});
  raytrace::SheetOptions sheet;
  sheet.columns = 1;
  sheet.gap = 0;
  constexpr int kQuality = 85, kPerSecond = 6;
  const std::string picture = base64(io::encode_jpeg(raytrace::contact_sheet(tiles, sheet), kQuality));
  const io::Image& first = strip.frames.front();
  return text + "<div class=\"turn\" data-views=\"" + std::to_string(tiles.size()) + "\" data-play=\"" +
         std::to_string(kPerSecond) + "\" style=\"width:" + std::to_string(first.width) +
         "px;height:" + std::to_string(first.height) + "px;background-image:url(data:image/jpeg;base64," + picture +
         ")\"></div></figure>\n";
}

}  // namespace anigen::eval
