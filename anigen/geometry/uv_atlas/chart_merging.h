#pragma once
#include <vector>

#include "anigen/geometry/uv_atlas/charts.h"

namespace anigen::geometry {

/// Splits a chart whose projection covers itself, like that of a spiral ramp, so that no texel's centre is in two faces
/// of a part: a part grows from a face over those that keep clear of it, and what is left makes further parts. Overlaps
/// that fit between the centres are not seen. The parts keep the chart's axis and are connected.
/// @param texels_per_unit the resolution at which overlaps count @param most_texels no finer than this many in the
/// chart's box
/// @return the chart alone when nothing overlaps
std::vector<SurfaceChart> without_overlaps(const PlanarChart& flat, const FaceAdjacency& adjacency,
                                           double texels_per_unit, double most_texels);

/// Cuts a chart across the middle of its longer side, along edges of faces. The halves keep the axis and are connected;
/// there can be more than two, or one when a single face is that long.
std::vector<SurfaceChart> cut_in_half(const PlanarChart& flat, const FaceAdjacency& adjacency);

}  // namespace anigen::geometry
