#pragma once
#include "anigen/raster/rasterize.h"

namespace anigen::raster {

/// Pairs of neighbouring pixels between whose centres a silhouette edge passes: what antialiasing blends. In order of
/// the first pixel's row, in each row those with the right neighbour before those with the one below.
struct SilhouettePairs {
  Tensor index;  ///< [K, 4] int64: first pixel (row · W + column), 1 if the other is below else 0, the edge's vertices
  Tensor weight;  ///< [K] fp64 in [-0.5, 0.5]: times (second − first) is added to the first pixel if positive, else
                  ///< to the second
  Tensor row_begin;  ///< [H + 1] int64: where each row's pairs begin
};

/// The edge belongs to the nearer pixel's triangle and is a silhouette: no other triangle continues the surface on its
/// far side. Edges with an end behind the camera are left out (reference README-ops.md, "Antialiasing").
/// @param fragments of these positions and faces @throws InputError when they cannot be
SilhouettePairs find_silhouette_pairs(const Fragments& fragments, const Tensor& clip, const Tensor& faces);

}  // namespace anigen::raster
