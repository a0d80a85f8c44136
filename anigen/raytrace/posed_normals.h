#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::raytrace {

/// Vertex normals of a mesh whose vertices moved: every normal of the file is turned as its vertex' surrounding
/// faces turned, which keeps hard and soft edges as the author set them. Without normals in the file: area-weighted.
std::vector<Eigen::Vector3f> posed_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& vertices);

}  // namespace anigen::raytrace
