#pragma once
#include <vector>

#include "anigen/raytrace/picture.h"

namespace anigen::raytrace {

/// `views` pictures at equal yaw steps around the asset, starting at options.view.yaw_degrees. The camera keeps one
/// distance, at which every view fits, so that the object does not pulsate.
/// @throws InputError when views is not in 1 … 3600, and as render()
std::vector<io::Image> turntable(const Asset& asset, const PictureOptions& options, int views);

}  // namespace anigen::raytrace
