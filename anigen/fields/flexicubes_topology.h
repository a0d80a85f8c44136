#pragma once
#include "anigen/fields/cube_field.h"
#include "anigen/fields/row_links.h"

namespace anigen::fields {

/// Everything about a dual surface that follows from the signs of the field (reference autoencoders.md, 4.3 and 4.4):
/// which cubes it passes, where its vertices belong, and its quads, in the published order. No dense grid is formed.
/// Q surface cubes, S grid vertices of them, D dual vertices, F quads. Tensors are on the CPU.
struct DualTopology {
  /// Surface cubes in ascending order.
  RowLinks weights;       ///< [Q] → row of CubeField::weights; −1: not an active cube
  Tensor cases;           ///< [Q] uint8, after ambiguous faces were decided
  Tensor corners;         ///< [Q, 8] int32: row of vertex_places
  Tensor first_dual;      ///< [Q] int32: dual vertex of the cube's first group; further groups follow
  Tensor first_crossing;  ///< [Q] int32: number of (dual vertex, edge) pairs in the cubes before

  /// Grid vertices of surface cubes in ascending order.
  Tensor vertex_places;   ///< [S, 3] int32
  RowLinks vertices;      ///< [S] → row of CubeField::vertices; −1: no active cube touches it
  Tensor corner_sources;  ///< [S, 8] int32: 8 q + k of the cube whose corner k it is; −1 for none

  std::int64_t duals = 0, crossings = 0;  ///< D, and (dual vertex, edge) pairs

  /// Corners of quads, four each, wound so that normals face outside.
  RowLinks quad_duals;  ///< [4F] → dual vertex
  RowLinks quad_cubes;  ///< [4F] → surface cube

  std::int64_t cubes() const { return cases.size(0); }
};

/// @param field as average_corners makes it; vertices sorted, on any device
DualTopology dual_topology(const CubeField& field);

}  // namespace anigen::fields
