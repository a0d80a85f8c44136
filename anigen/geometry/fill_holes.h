#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

struct HoleFilling {
  std::size_t most_edges = 32;  ///< along the border of a hole that is closed; others stay open
  bool refine = true;           ///< give patches triangles of the size of those around them, which adds vertices
};

struct FilledMesh {
  Mesh mesh;                  ///< vertices and faces alone; the old ones first and in their order, then the new
  std::size_t filled = 0;     ///< holes that were closed
  std::size_t left_open = 0;  ///< loops that are too long, or whose only patch is a face that exists already
  std::size_t broken = 0;  ///< borders that surround nothing that could be closed, since they run into an edge of more
                           ///< than two faces or along faces that disagree about which side is up
};

/// Closes the small holes of a surface as the published pipeline does after it removes hidden faces
/// (docs/reference/flows.md, 5.6): each loop of border edges is triangulated so that it bends least, then refined
/// (Liepa 2003). Never makes an edge of more than two faces: where a hole cannot be triangulated by its own points
/// without one, its faces meet in a new point in its middle. Faces that name a vertex twice are dropped, vertices
/// without faces are kept. Deterministic; runs on the calling thread.
/// @throws InputError when a face refers to a missing vertex
FilledMesh fill_holes(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const HoleFilling& options = {});

}  // namespace anigen::geometry
