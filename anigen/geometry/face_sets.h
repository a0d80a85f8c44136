#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/mesh_edges.h"

namespace anigen::geometry {

/// Parts of meshes: faces chosen by a mark per face, 0 for no.
using FaceMarks = std::vector<char>;

/// The faces that name three different vertices, in order.
std::vector<Triangle> proper_faces(const std::vector<Triangle>& faces);

/// Faces that hang together by edges, as lists of faces, each ascending; in the order of their first faces.
/// @param chosen [F], or empty for all faces
std::vector<std::vector<std::int32_t>> face_components(const MeshEdges& edges, std::size_t faces,
                                                       const FaceMarks& chosen = {});

/// The chosen faces and the vertices they use, both in their old order; nothing else of a mesh.
/// @pre faces refer to vertices that exist, one mark per face
Mesh chosen_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                  const FaceMarks& chosen);

}  // namespace anigen::geometry
