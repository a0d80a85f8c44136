#pragma once
#include <cmath>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/render/cameras_json.h"

/// Shapes and cameras whose views can be worked out by hand.
namespace anigen::test {

/// [-0.5, 0.5]³, faces counter-clockwise from outside.
inline Asset cube() {
  Asset asset;
  asset.name = "cube";
  for (int i = 0; i < 8; ++i)
    asset.mesh.vertices.emplace_back(i & 1 ? 0.5f : -0.5f, i & 2 ? 0.5f : -0.5f, i & 4 ? 0.5f : -0.5f);
  asset.mesh.faces = {{1, 3, 7}, {1, 7, 5}, {2, 0, 4}, {2, 4, 6}, {3, 2, 6}, {3, 6, 7},
                      {0, 1, 5}, {0, 5, 4}, {4, 5, 7}, {4, 7, 6}, {2, 3, 1}, {2, 1, 0}};
  return asset;
}

/// The published feature camera at an angle (degrees): radius 2, field of view 40°.
inline render::Frame frame_at(double yaw_degrees, double pitch_degrees, double radius = 2.0) {
  render::ViewCamera view;
  view.yaw = yaw_degrees * M_PI / 180.0;
  view.pitch = pitch_degrees * M_PI / 180.0;
  view.radius = radius;
  view.fov = render::kFeatureFov;
  return render::make_frame(view, "000.png");
}

}  // namespace anigen::test
