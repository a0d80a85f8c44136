#pragma once
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/creatures/shapes.h"

namespace anigen::creatures {

/// The boundary of a Field as a closed, connected, orientable two-manifold.
struct Surface {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3d> normals;  ///< outward, unit length
  std::vector<Triangle> faces;           ///< counter-clockwise seen from outside
  std::vector<int> vertex_lists;         ///< per vertex, index into lists
  std::vector<PrimitiveList> lists;      ///< primitives near a block of the grid
};

/// Surface nets (Gibson 1998) on the blocks of a regular grid that the surface passes through: one vertex per cell
/// whose corners differ in sign, one quad per grid edge that does. Cells whose corners would make the result
/// non-manifold (two inside corners that only touch across a face or through the cell) are repaired first by turning
/// corners into inside ones, which makes the sampled solid well-composed; small separate pieces and closed cavities
/// are dropped. Vertices are then pulled onto the field by Newton steps inside their cell.
/// @param spacing     grid spacing; primitives thinner than a cell are thickened
/// @param relaxations tangential smoothing steps before the last projection; 0 keeps edges where the grid put them
/// @return no vertices at all when this spacing cannot be repaired locally: try another one
///
/// Edges and seams are rounded by about a spacing, since a mesh without sharp features would show them ragged.
Surface extract_surface(const std::vector<Primitive>& primitives, double spacing, int relaxations);

/// Estimated number of vertices of extract_surface(), from a coarse grid; within some ten percent.
double estimate_vertices(const std::vector<Primitive>& primitives, double spacing);

}  // namespace anigen::creatures
