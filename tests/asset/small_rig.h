#pragma once
#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// Two triangles on a chain of three joints along x at 0, 1 and 2; vertex v sits at x = v / 2, weights blend
/// between neighbours. Sound by validate().
inline Asset small_rig() {
  Asset asset;
  asset.name = "small";
  asset.mesh.vertices = {{0, 0, 0}, {0.5f, 1, 0}, {1, 0, 0}, {1.5f, 1, 0.5f}};
  asset.mesh.faces = {{0, 1, 2}, {2, 1, 3}};
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {-1, 0, 1}, {"root", "mid", "tip"});
  asset.skin.append_row({{0, 1.0f}});
  asset.skin.append_row({{0, 0.5f}, {1, 0.5f}});
  asset.skin.append_row({{1, 3.0f}, {0, 1.0f}});
  asset.skin.append_row({{1, 0.25f}, {2, 0.75f}});
  Animation animation;
  animation.name = "wave";
  animation.channels.push_back({1,
                                ChannelPath::kRotation,
                                Interpolation::kLinear,
                                {0.0, 1.0},
                                {0, 0, 0, 1, 0, 0, 0.70710678118654752, 0.70710678118654752}});
  animation.channels.push_back({0,
                                ChannelPath::kTranslation,
                                Interpolation::kCubicSpline,
                                {0.0, 2.0},
                                {0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 2, 0, 0, 0, 0, 0}});
  asset.animations.push_back(animation);
  return asset;
}

}  // namespace anigen::test
