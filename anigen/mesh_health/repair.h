#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"

namespace anigen::mesh_health {

struct RepairOptions {
  double merge_distance = 0.0;  ///< share of the box's diagonal within which vertices become one; 0: equal positions
  std::size_t fill_edges = 0;   ///< holes with so many border edges or fewer are closed; 0: none
};

struct Repaired {
  /// Vertices and faces alone: every edge has one or two faces that agree about the outside, every vertex one fan of
  /// faces, closed parts are wound outward.
  Mesh mesh;
  std::vector<std::int32_t> place;  ///< [V] of the welded mesh (weld()); -1 for a new vertex
  std::size_t merged_vertices = 0;  ///< that became one with another place
  std::size_t isolated_vertices = 0, duplicate_faces = 0, degenerate_faces = 0;  ///< that are gone
  std::size_t reversed_faces = 0, copied_vertices = 0, stitched_edges = 0;       ///< as CleanSurface
  std::size_t turned_parts = 0;                                                  ///< closed parts that were inside out
  std::size_t filled_holes = 0, open_holes = 0;
  std::size_t degenerate_left = 0;
};

/// Mends a surface in place: vertices that coincide become one, faces without area and repetitions go, the rest is made
/// an oriented manifold (clean_surface()), parts that enclose a volume are wound outward unless they are cavities,
/// small holes are filled (geometry::fill_holes).
///
/// Vertices that stay apart at one position, where solids touch, are moved by a millionth of the diagonal into their
/// own part, since formats without indices, and programs that weld, would make them one again. All other positions
/// stay.
/// @throws InputError as weld(), Error when nothing is left or CGAL gives up
Repaired repair(const Mesh& mesh, const RepairOptions& options = {});

/// Counts of what was done.
Json to_json(const Repaired& repaired);

/// Distance of RepairOptions in the mesh's unit. @throws InputError naming the first vertex that is not finite
double merge_distance(const Mesh& mesh, const RepairOptions& options);

}  // namespace anigen::mesh_health
