#pragma once
#include <vector>

#include "anigen/fields/cube_field.h"

namespace anigen::fields {

struct NearestGridVertices {
  Tensor rows;     ///< [P, count] int64 rows of field.vertices, nearest first, ties by row
  Tensor squared;  ///< [P, count] fp64 squared distances
};

/// The grid vertices of a field nearest to points, by looking at the boxes of grid cells around each point; exact.
/// Entries beyond the number of vertices, or of points that are NaN, are row 0 at distance 0.
/// @param points [P, 3], any device @param deformed measure to field.positions(), else to field.grid_positions()
NearestGridVertices nearest_grid_vertices(const CubeField& field, const Tensor& points, std::int64_t count,
                                          bool deformed);

}  // namespace anigen::fields
