#pragma once
#include "anigen/raster/viewport.h"

namespace anigen::raster {

/// The nearest triangle at every pixel centre, and of several equally near ones the first. Edges that two triangles
/// share are covered by exactly one of them: positions are integers, and a centre on an edge belongs to the triangle
/// whose left or top edge it is. Runs on all threads, each drawing some rows; the same result for any number.
/// @param clip [V, 4], finite @param faces [F, 3], valid
/// @param depth [H, W] z/w; infinity where there is nothing @param triangle [H, W] index + 1; 0 where there is nothing
void find_visible(const Viewport& viewport, const double* clip, const std::int64_t* faces, std::int64_t face_count,
                  double* depth, std::int64_t* triangle);

}  // namespace anigen::raster
