#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::mesh_health {

/// Faces that go through others.
struct SelfIntersections {
  std::size_t pairs = 0;
  std::vector<char> same_part;   ///< [F] not 0: the face crosses a face of its own part
  std::vector<char> other_part;  ///< [F] not 0: it crosses a face of another part
};

/// Pairs of triangles that share a point beyond their common vertices, decided exactly. Touching counts; so do
/// triangles that lie on each other. Triangles without area are left out. On the calling thread.
/// @param faces none of them names a vertex twice @param parts [F]
/// @throws Interrupted
SelfIntersections self_intersections(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                                     const std::vector<std::size_t>& parts);

}  // namespace anigen::mesh_health
