#pragma once
#include <cstddef>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"
#include "anigen/mesh_health/limited.h"

namespace anigen::mesh_health {

struct RemeshOptions {
  double edge_length = 0.0;            ///< in the mesh's unit; 0: as `faces` says
  std::size_t faces = 0;               ///< wanted number; 0: as `edge_length` says; both 0: as many as there are
  double sharp_angle = 40.0;           ///< degrees: edges whose faces turn by more stay where they are; 180: none
  std::size_t iterations = 5;          ///< rounds of splitting, collapsing, flipping and smoothing
  std::size_t most_faces = 5'000'000;  ///< refuse beyond
};

struct Remeshed {
  Mesh mesh;                    ///< vertices and faces alone
  double edge_length = 0.0;     ///< that was aimed at in the end, in the mesh's unit
  std::size_t sharp_edges = 0;  ///< of the cleaned mesh, that kept their place
  std::size_t attempts = 1;     ///< passes until the number of faces was within 5 %
};

/// Triangles of equal size and good shape on the same surface (Botsch and Kobbelt 2004, CGAL's isotropic_remeshing).
/// The mesh is made a manifold with closed parts wound outward, as repair() does. Borders and sharp edges are split and
/// collapsed only along themselves; their corners, and where three of them meet, stay. Parts smaller than the edge
/// length keep a few faces. On the calling thread.
/// @param report passes done, of those that may be needed
/// @throws InputError as weld(), for a mesh without area, an edge length that is not above 0, or more than
/// `most_faces`; Error when CGAL gives up; Interrupted between passes
Remeshed remesh(const Mesh& mesh, const RemeshOptions& options = {}, const StepReport& report = {});

Json to_json(const Remeshed& remeshed);

}  // namespace anigen::mesh_health
