#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen {

/// Vertex normals [V] in which each face counts by its angle at the vertex (Thürmer and Wüthrich 1998), as in the
/// published export (reference flows-and-pipeline.md, 5.11); unlike those of vertex_normals() they do not depend on how
/// a flat part is cut into triangles. Unit length; (0, 0, 1) where no face with area gives one.
/// @pre faces refer to vertices that exist
std::vector<Eigen::Vector3f> angle_weighted_normals(const std::vector<Eigen::Vector3f>& vertices,
                                                    const std::vector<Triangle>& faces);

}  // namespace anigen
