#include "anigen/raytrace/views/preview_views.h"

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::raytrace {
namespace {

constexpr double kPublishedTurn = 2.0 * 3.1415;

}  // namespace

ViewCamera from_preview(const ViewCamera& preview) {
  ViewCamera view = preview;
  view.yaw = 0.5 * kPi - preview.yaw;
  return view;
}

std::vector<ViewCamera> preview_turn(std::size_t frames) {
  if (frames == 0) throw InputError("", "frames", "there must be at least one frame");
  std::vector<ViewCamera> views(frames);
  for (std::size_t i = 0; i < frames; ++i) {
    const double last = frames > 1 ? static_cast<double>(frames - 1) : 1.0;
    const double yaw = kPublishedTurn * static_cast<double>(i) / last;
    views[i] = {yaw, 0.25 + 0.5 * std::sin(yaw), kFeatureRadius, kFeatureFov};
  }
  return views;
}

std::vector<ViewCamera> snapshot_views() {
  std::vector<ViewCamera> views;
  for (int side = 0; side < 4; ++side) {
    views.push_back({(90.0 * side - 16.0) * kPi / 180.0, 20.0 * kPi / 180.0, kFeatureRadius, kFeatureFov});
  }
  return views;
}

}  // namespace anigen::raytrace
