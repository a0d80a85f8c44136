#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/hidden_faces.h"

namespace anigen::geometry {

/// Marks the faces that another face of the mesh goes through [F]: of two such faces an edge of one pierces the other,
/// and both are marked. An edge does not pierce the faces at its own two vertices, so weld vertices that lie in one
/// place first; faces that only touch or lie in one plane may count or not. Edges as rays through a BVH, on all
/// threads; the result does not depend on them.
/// @param vertices [V], any unit @param edges of these faces
/// @throws InputError when a face refers to a missing vertex, or a position is not finite or beyond 1e15
FaceMarks crossed_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                        const MeshEdges& edges);

}  // namespace anigen::geometry
