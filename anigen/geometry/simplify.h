#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Share of faces that the published pipeline takes away (docs/reference/flows.md, 5.6).
inline constexpr double kPublishedReduction = 0.95;

/// Faces that are left of `faces` after that share is taken away, at least 1.
/// @throws InputError unless 0 ≤ reduction < 1
std::size_t reduced_face_count(std::size_t faces, double reduction);

struct Simplified {
  Mesh mesh;  ///< vertices and faces alone; vertices are new, in no relation to the old ones
  std::size_t faces_before = 0;
  bool reached = true;     ///< false: no further edge could go, the mesh has more faces than asked for
  std::size_t locked = 0;  ///< vertices that had to stay, since more than two faces meet at an edge of theirs
};

/// Fewer faces by collapsing edges, the cheapest first, each into the place with the least sum of squared distances to
/// the planes of the faces that went into it (Garland and Heckbert 1997; in place of VTK's decimation in
/// docs/reference/flows.md, 5.6). A small share of the distances counts to the faces' middles in place of their planes,
/// so that flat parts get triangles of good shape (Trettner and Kobbelt 2020, isotropic noise of normals).
///
/// Topology stays: only edges that satisfy the link condition go (Dey et al. 1999), so a closed surface stays closed,
/// no edge gets a third face, and neither parts nor handles vanish. No face turns over. Borders of open surfaces keep
/// their shape by planes across them. Faces that name a vertex twice and vertices without faces are dropped.
/// Deterministic; runs on the calling thread.
/// @throws InputError when a face refers to a missing vertex or a position is not finite, or target_faces is 0
Simplified simplify(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                    std::size_t target_faces);

}  // namespace anigen::geometry
