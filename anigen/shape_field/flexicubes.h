#pragma once
#include <array>
#include <cstdint>

#include "anigen/shape_field/cube_field.h"
#include "anigen/shape_field/row_links.h"

namespace anigen::shape_field {

inline constexpr int kCubeEdges = 12;

/// The corners of each edge of a cube in stored order, which decides the order of grid edges and the winding of faces:
/// x-edges 0, 2, 4, 6, z-edges 1, 3, 5, 7, y-edges 8 to 11 from high y to low y (docs/reference/autoencoders.md, 5.2).
inline constexpr std::array<std::array<int, 2>, kCubeEdges> kEdgeCorners = {
    {{0, 1}, {1, 5}, {4, 5}, {0, 4}, {2, 3}, {3, 7}, {6, 7}, {2, 6}, {2, 0}, {3, 1}, {7, 5}, {6, 4}}};

/// The edge that leaves a corner along an axis, upwards. @param corner whose bit of that axis is 0
int edge_from_corner(int corner, int axis);

/// Dual Marching Cubes: which crossing edges of a cube share a dual vertex. The case of a cube is the sum of 2^k over
/// the corners k inside. Made from the rules of docs/reference/autoencoders.md, 5.3, and equal to the published tables.
struct FlexicubesTables {
  static constexpr int kCases = 256, kMostGroups = 4, kMostEdges = 7;

  /// Edges of each group in ascending order, padded with −1.
  std::array<std::array<std::array<std::int16_t, kMostEdges>, kMostGroups>, kCases> groups{};
  std::array<std::int16_t, kCases> counts{};  ///< number of groups
  /// Flag, outward direction x, y, z of the ambiguous face, and the case to take instead when the cube across that face
  /// is flagged too; zeros without a flag.
  std::array<std::array<std::int16_t, 5>, kCases> ambiguity{};

  /// Groups by edge: its group, its place in that group; −1 for an edge that does not cross.
  std::array<std::array<std::int8_t, kCubeEdges>, kCases> group_of_edge{}, slot_of_edge{};
  std::array<std::int16_t, kCases> crossings{};  ///< number of crossing edges
};

/// Made at the first call.
const FlexicubesTables& flexicubes_tables();

/// Everything about a dual surface that follows from the signs of the field (docs/reference/autoencoders.md, 5.2 and
/// 5.3): which cubes it passes, where its vertices belong, and its quads, in the published order. No dense grid is
/// formed. Q surface cubes, S grid vertices of them, D dual vertices, F quads. Tensors are on the CPU.
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

struct ExtractedSurface {
  Tensor vertices;    ///< [V, 3] object space; empty [0, 3] without a sign change
  Tensor faces;       ///< [F, 3] int64, counter-clockwise seen from outside (positive sdf)
  Tensor attributes;  ///< [V, A]
  Tensor deviation;   ///< [K] L_dev, one value per (dual vertex, crossing edge); only filled when training
};

/// Dual surface of the zero level set with FlexiCubes' weights (Shen et al. 2023; docs/reference/autoencoders.md, 5.2):
/// vertices, faces and attributes in the published order, on the field's device. Differentiable once in the field, away
/// from sign changes. Inside is sdf < 0; where the surface reaches the boundary of the grid it stays open. Two sheets
/// that pass an ambiguous cube may meet in an edge of more than two faces, as with every dual method. Edges whose first
/// end has sdf exactly 0 are wound as published, that is, facing inside. Memory follows the cubes at the surface.
/// @param training quads become four triangles around a centre vertex, and the deviation is computed; otherwise two
/// along the diagonal that gamma chooses
ExtractedSurface flexicubes(const CubeField& field, bool training);

}  // namespace anigen::shape_field
