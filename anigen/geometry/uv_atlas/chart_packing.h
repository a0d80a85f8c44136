#pragma once
#include <vector>

#include "anigen/geometry/uv_atlas/planar_chart.h"

namespace anigen::geometry {

/// Where a chart lies in the square: turned, then moved by whole texels.
struct ChartPlace {
  int turns = 0;     ///< quarter turns, counter-clockwise
  int x = 0, y = 0;  ///< of the lower left corner of the chart's box, in texels from that of the square
};

struct ChartPacking {
  double texels_per_unit = 0.0;    ///< the same for all charts
  std::vector<ChartPlace> places;  ///< one per chart
  double occupancy = 0.0;          ///< area of the charts over that of the square
};

/// Places charts in a square of texels, as large as they can all be: from the longest to the shortest each takes the
/// lowest place, then the leftmost, where its shape is free, in whichever of four orientations it ends lowest; the
/// scale is searched until it is within one and a half percent of one that does not fit. Between the texels that two
/// charts touch there are at least `gutter` others, and half as many, rounded up, along the sides of the square.
/// @param size texels along a side @throws InputError when the charts are too many even for the smallest scale
ChartPacking pack_charts(const std::vector<PlanarChart>& charts, int size, int gutter);

}  // namespace anigen::geometry
