#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Coordinates beyond this are refused: Embree silently drops triangles near 1.8e18, and squares must stay finite.
inline constexpr float kLargestCoordinate = 1e15f;

/// @param file,array only for the message
/// @throws InputError naming the first vertex that is not finite or too large, or the first face with a bad index
void check_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                const std::string& file = "", const std::string& array = "mesh");

}  // namespace anigen::geometry
