#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::mesh_health {

/// A surface in which every edge has one or two faces that agree about the outside, and every vertex one fan of faces.
struct CleanSurface {
  Mesh mesh;                         ///< vertices and faces alone; no vertex without faces
  std::size_t reversed_faces = 0;    ///< turned to agree with their neighbours
  std::size_t copied_vertices = 0;   ///< where surfaces meet that were parted
  std::size_t stitched_edges = 0;    ///< pairs of border edges in one place that became an edge
  std::size_t degenerate_faces = 0;  ///< without area, that are gone
  std::size_t degenerate_left = 0;   ///< that could not be taken away without changing the topology
};

/// Parts surfaces that meet (part_faces()), orients what hangs together, as most of its faces are, takes away faces
/// without area, and stitches border edges that are in one place, those of one part first. Where surfaces still meet,
/// or have no two sides, they are cut. By CGAL's package Polygon_mesh_processing. Positions stay.
/// @pre no face names a vertex twice, and no face is there twice
/// @throws Error when CGAL gives up
CleanSurface clean_surface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

}  // namespace anigen::mesh_health
