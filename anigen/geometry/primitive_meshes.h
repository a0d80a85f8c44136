#pragma once
#include <Eigen/Core>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// A closed sphere around the origin: an icosahedron whose triangles are cut in four `subdivisions` times, with all
/// vertices on the sphere. 20 · 4ⁿ faces, counter-clockwise from outside.
/// @throws InputError unless 0 ≤ subdivisions ≤ 8
Mesh icosphere(int subdivisions, double radius);

/// A closed cone with a round base of `sections` corners around `base`, its axis towards `apex`.
/// 2 · sections faces, counter-clockwise from outside.
/// @throws InputError with fewer than 3 sections, or when base and apex are the same
Mesh cone(const Eigen::Vector3d& base, const Eigen::Vector3d& apex, double radius, int sections);

}  // namespace anigen::geometry
