#pragma once
#include <array>
#include <vector>

#include "anigen/raster/viewport.h"

namespace anigen::raster {

/// A triangle ready to be drawn: where it covers pixel centres, and its depth there. A triangle that had to be clipped
/// becomes several of these, all with the plane of the whole.
struct ScreenTriangle {
  std::array<std::int32_t, 3> x, y;                             ///< corners in steps of 1/2^subpixel_bits pixel
  std::int32_t first_column, last_column, first_row, last_row;  ///< of the pixel centres that it may cover
  std::int32_t face;
  double depth_at_origin, depth_per_column, depth_per_row;  ///< z/w as a plane over pixels, from unsnapped corners
  double nearest, farthest;                                 ///< z/w of the visible corners bounds it
};

/// Appends what there is to draw of one face; nothing when it lies outside the picture, covers no pixel centre or has
/// no area. Corners turn so that the area is positive (x right, y down).
/// @param clip [V, 4] @param corners its three vertices
void append_screen_triangles(const Viewport& viewport, const double* clip, const std::int64_t* corners,
                             std::int32_t face, std::vector<ScreenTriangle>& triangles);

}  // namespace anigen::raster
