#pragma once
#include <string>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// Refuses what no mesh file can hold: no vertices, numbers that are not finite, arrays of another length than the
/// vertices, faces that refer to missing vertices. @throws InputError naming the file and the array
void refuse_unsound_mesh(const Mesh& mesh, const std::string& file);

/// Unit length; +Z for a vector without direction, which the contract of Mesh::normals does not allow.
Eigen::Vector3f unit_normal(const Eigen::Vector3f& normal);

/// An array index as the 32-bit number that faces hold. @throws InputError beyond 2^31 - 1
std::int32_t face_index(std::size_t index, const std::string& file);

}  // namespace anigen::io
