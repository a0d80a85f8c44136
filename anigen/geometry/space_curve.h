#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace anigen::geometry {

/// The points' indices along a Morton curve of 1,024³ cells through their box: neighbours in the list are mostly
/// neighbours in space. Points of one cell keep their order. At most 2³² points, which must be finite.
std::vector<std::uint32_t> along_curve(const std::vector<Eigen::Vector3d>& points);

}  // namespace anigen::geometry
