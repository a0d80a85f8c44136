#include "anigen/eval/inspect/asset_picture.h"

#include <cstdio>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/geometry/skeleton_mesh.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"

namespace anigen::eval {
namespace {

using raytrace::PictureMode;
using raytrace::PictureOptions;
using raytrace::Tile;

std::string joints(const Asset& asset) { return std::to_string(asset.skeleton.size()) + " joints"; }

std::vector<Tile> skinned(const Asset& asset, PictureOptions options) {
  std::vector<Tile> tiles = {{raytrace::render(asset, options), "colour"}};
  options.mode = PictureMode::kWeights;
  tiles.push_back({raytrace::render(asset, options), "skin weights"});
  options.skeleton = true;
  tiles.push_back({raytrace::render(asset, options), joints(asset)});
  return tiles;
}

std::vector<Tile> unskinned(const Asset& asset, PictureOptions options) {
  if (asset.mesh.faces.empty()) throw InputError("", "", "points without faces cannot be drawn");
  std::vector<Tile> tiles = {{raytrace::render(asset, options), "colour"}};
  if (asset.skeleton.size() > 0) {
    options.skeleton = true;
    tiles.push_back({raytrace::render(asset, options), joints(asset) + ", no skin weights"});
  } else {
    options.mode = PictureMode::kNormals;
    tiles.push_back({raytrace::render(asset, options), "normals; no rig"});
  }
  return tiles;
}

Asset solid(const Skeleton& skeleton, const Pose& pose) {
  std::vector<Eigen::Vector3d> places;
  for (const Eigen::Matrix4d& world : forward_kinematics(skeleton.parents, pose))
    places.emplace_back(world.topRightCorner<3, 1>());
  return geometry::skeleton_asset(skeleton_from_joints(places, skeleton.parents, skeleton.names));
}

std::vector<Tile> skeleton(const Asset& asset, const PictureOptions& options) {
  std::vector<Tile> tiles = {{raytrace::render(solid(asset.skeleton, asset.skeleton.rest), options), joints(asset)}};
  if (asset.animations.empty()) return tiles;
  const Animation& animation = asset.animations.front();
  const double time = animation.duration() / 2.0;
  char seconds[32];
  std::snprintf(seconds, sizeof seconds, " at %.2f s", time);
  tiles.push_back({raytrace::render(solid(asset.skeleton, sample(animation, asset.skeleton, time)), options),
                   animation.name + seconds});
  return tiles;
}

}  // namespace

io::Image asset_picture(const Asset& asset, int size) {
  PictureOptions options;
  options.width = options.height = size;
  const std::vector<Tile> tiles = asset.skin.rows() > 0          ? skinned(asset, options)
                                  : !asset.mesh.vertices.empty() ? unskinned(asset, options)
                                                                 : skeleton(asset, options);
  raytrace::SheetOptions sheet;
  sheet.columns = static_cast<int>(tiles.size());
  sheet.title = asset.name;
  return raytrace::contact_sheet(tiles, sheet);
}

}  // namespace anigen::eval
