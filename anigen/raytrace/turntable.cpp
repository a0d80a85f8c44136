#include "anigen/raytrace/turntable.h"

#include <algorithm>

#include "anigen/core/error.h"

namespace anigen::raytrace {

std::vector<io::Image> turntable(const Asset& asset, const PictureOptions& options, int views) {
  if (views < 1 || views > 3600) throw InputError("", "views", "must be between 1 and 3600");
  const Scene scene(asset, options.vertices);
  std::vector<PictureOptions> turns(static_cast<std::size_t>(views), options);
  double distance = 0.0;
  for (int i = 0; i < views; ++i) {
    Orbit& view = turns[static_cast<std::size_t>(i)].view;
    view.yaw_degrees += 360.0 * i / views;
    distance = std::max(distance, centred_distance(view, scene.vertices(), options.width, options.height));
  }
  std::vector<io::Image> pictures;
  for (PictureOptions& turn : turns) {
    turn.view.distance = distance;
    pictures.push_back(render(scene, turn));
  }
  return pictures;
}

}  // namespace anigen::raytrace
