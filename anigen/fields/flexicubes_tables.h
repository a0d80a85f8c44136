#pragma once
#include <array>
#include <cstdint>

namespace anigen::fields {

inline constexpr int kCubeEdges = 12;

/// The corners of each edge of a cube in stored order, which decides the order of grid edges and the winding of faces:
/// x-edges 0, 2, 4, 6, z-edges 1, 3, 5, 7, y-edges 8 to 11 from high y to low y (reference autoencoders.md, 4.3).
inline constexpr std::array<std::array<int, 2>, kCubeEdges> kEdgeCorners = {
    {{0, 1}, {1, 5}, {4, 5}, {0, 4}, {2, 3}, {3, 7}, {6, 7}, {2, 6}, {2, 0}, {3, 1}, {7, 5}, {6, 4}}};

/// The edge that leaves a corner along an axis, upwards. @param corner whose bit of that axis is 0
int edge_from_corner(int corner, int axis);

/// Dual Marching Cubes: which crossing edges of a cube share a dual vertex. The case of a cube is the sum of 2^k over
/// the corners k inside. Made from the rules of reference autoencoders.md, 4.4, and equal to the published tables.
struct FlexicubesTables {
  static constexpr int kCases = 256, kMostGroups = 4, kMostEdges = 7;

  /// Edges of each group in ascending order, padded with −1.
  std::array<std::array<std::array<std::int16_t, kMostEdges>, kMostGroups>, kCases> groups{};
  std::array<std::int16_t, kCases> counts{};  ///< number of groups
  /// Flag, outward direction x, y, z of the ambiguous face, and the case to take instead when the cube across that face
  /// is flagged too; zeros without a flag.
  std::array<std::array<std::int16_t, 5>, kCases> ambiguity{};

  /// The same groups seen from an edge: its group, its place in that group; −1 for an edge that does not cross.
  std::array<std::array<std::int8_t, kCubeEdges>, kCases> group_of_edge{}, slot_of_edge{};
  std::array<std::int16_t, kCases> crossings{};  ///< number of crossing edges
};

/// Made at the first call.
const FlexicubesTables& flexicubes_tables();

}  // namespace anigen::fields
